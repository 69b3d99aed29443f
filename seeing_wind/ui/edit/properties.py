"""The settings of the step *Edit*: bodies, colliders, and several edits of one field.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, FloatVectorProperty, IntProperty, PointerProperty, StringProperty

from ...engine.settings import BodyEdit, BuildSettings, ColliderEdit, Edit, options_of
from ..job.notes import SEEING_WIND_PG_note
from ..option_properties import property_of, with_options
from ..property_kinds import KEPT, MATERIAL_ITEMS, changed, choice, is_mesh, number, toggle


class Line:
    """Mix-in for an entry of the panel's lists."""

    @property
    def called(self) -> str:
        """The name the user knows: that of the object, which may have been renamed; the last known name if the object is gone."""
        return self.name if self.object is None else self.object.name


@with_options(BodyEdit)
class SEEING_WIND_PG_body(Line, bpy.types.PropertyGroup):
    """One body of the edit: a mesh object, or the clip's own object."""

    is_recovered: BoolProperty(name="Recovered Object", description="The object of the clip itself, at its recovered material")
    object: PointerProperty(name="Object", type=bpy.types.Object, poll=is_mesh, description="The mesh to move", update=changed)
    open_area: FloatProperty(options={"HIDDEN"}, description="Of an open mesh (m²); 0 for a closed one")
    no_sheet: StringProperty(options={"HIDDEN"}, description="Why a thin material does not suit its mesh; empty if it does")
    material: choice("Material", "What the body is made of", MATERIAL_ITEMS, BuildSettings.material)
    pin_group: StringProperty(
        name="Pinned", update=changed,
        description="Vertex group whose vertices are held in place: weight 1 holds firmly, less draws back like a spring",
    )  # fmt: skip
    free_mode: choice("Held Places", "What becomes of the places at which the object was held in the clip", [
        ("KEEP", "Keep", "The object stays held where it was held in the clip"),
        ("ALL", "Let Go", "Nothing holds the object any more, but for its pinned vertices"),
        ("GROUP", "Let Go of a Group", "The vertices of a group are let go"),
    ])  # fmt: skip
    free_group: StringProperty(name="Group", description="Vertex group of the vertices that are let go", update=changed)

    result: StringProperty(options={"HIDDEN"}, description="Name of the body in the last re-simulation")
    baked_copy: PointerProperty(type=bpy.types.Object, options={"HIDDEN"}, description="Carries the motion where the object itself cannot")


@with_options(ColliderEdit)
class SEEING_WIND_PG_collider(Line, bpy.types.PropertyGroup):
    """Something that stands in the bodies' way and is not moved by them."""

    object: PointerProperty(
        name="Object", type=bpy.types.Object, poll=is_mesh, description="The mesh that the bodies collide with", update=changed
    )


@with_options(Edit)
class EditOptions:
    """One edit: the scene has the one that is worked on, and keeps the others to compare with."""

    bodies: CollectionProperty(type=SEEING_WIND_PG_body)
    active_body: IntProperty(name="Active Body", default=0, min=0)
    colliders: CollectionProperty(type=SEEING_WIND_PG_collider)
    active_collider: IntProperty(name="Active Collider", default=0, min=0)
    use_floor: toggle("Floor", "A level floor under everything")
    floor_height: number("Height (m)", 0.0, "Of the floor, along world Z", soft_min=-10.0, soft_max=10.0, step=1, precision=3)
    floor_friction: property_of(options_of(ColliderEdit)["friction"])
    field_strength: property_of(
        options_of(Edit)["field_strength"], options=KEPT | {"ANIMATABLE"}, description="Factor on the recovered field; its keyframes count"
    )
    use_force_fields: toggle("Force Fields", "Blender's own force fields act beside the recovered one, in newtons on a whole body", True)
    use_further_fields: toggle("All Fields", "Every recovered field and wind of the scene moves the bodies, not only the scene's own one")
    effectors: PointerProperty(
        name="Effector Collection", type=bpy.types.Collection, update=changed,
        description="Only the force fields of this collection act; empty: all of the scene",
    )  # fmt: skip
    edit_gravity_mode: choice("Gravity", "Gravity in the re-simulation", [
        ("SAME", "As Recovered", "The gravity that Recover was given"),
        ("NONE", "None", "No gravity"),
        ("CUSTOM", "Custom", "An acceleration of your own"),
    ])  # fmt: skip
    offset: FloatVectorProperty(
        name="Offset (m)", size=3, soft_min=-10.0, soft_max=10.0, step=10, update=changed,
        description="Where this edit is shown, to stand beside another; it is simulated at the place that it was copied from",
    )  # fmt: skip

    edit_folder: StringProperty(options={"HIDDEN"})
    simulated_digest: StringProperty(options={"HIDDEN"})
    simulated_take: StringProperty(options={"HIDDEN"})
    simulated_stamp: StringProperty(options={"HIDDEN"}, description="Of its motion: tells when another one has taken its place")
    simulated_notes: CollectionProperty(type=SEEING_WIND_PG_note)
    coarse_digest: StringProperty(options={"HIDDEN"}, description="Of the settings of the last preview")
    coarse_take: StringProperty(options={"HIDDEN"}, description="Folder that the last preview is in")
    coarse_stamp: StringProperty(options={"HIDDEN"}, description="Of the preview's motion, likewise")
    coarse_notes: CollectionProperty(type=SEEING_WIND_PG_note)
    baked_digest: StringProperty(options={"HIDDEN"})


class SEEING_WIND_PG_edit(EditOptions, bpy.types.PropertyGroup):
    """An edit that is kept while another one is worked on."""


def _switch_edit(self, context) -> None:
    from .edits import switch  # needs NumPy, whose import a user with a single edit need not wait for

    switch(self)


class EditSettings:
    """The edits that are kept beside the one that is worked on."""

    edits: CollectionProperty(type=SEEING_WIND_PG_edit)
    active_edit: IntProperty(name="Active Edit", default=0, min=0, update=_switch_edit)
    loaded_edit: IntProperty(options={"HIDDEN"}, default=0, min=0, description="The edit whose settings the scene has now")


CLASSES = (SEEING_WIND_PG_body, SEEING_WIND_PG_collider, SEEING_WIND_PG_edit)
