"""The settings of the step *Edit*: bodies, what is in their way, and several edits of one field.

No postponed annotations here: Blender reads these annotations as property definitions.
"""

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, FloatVectorProperty, IntProperty, PointerProperty, StringProperty

from ...engine.conventions import GRAVITY
from ...engine.settings import BuildSettings
from ..property_kinds import KEPT, KINDS, MATERIAL_ITEMS, changed, choice, is_mesh, number, toggle
from .sheet_label import measure


def _object_changed(self, context) -> None:
    measure(self, context)
    changed(self, context)


class SEEING_WIND_PG_body(bpy.types.PropertyGroup):
    """One body of the edit: a mesh object, or the clip's own object."""

    is_recovered: BoolProperty(name="Recovered Object", description="The object of the clip itself, at its recovered material")
    object: PointerProperty(name="Object", type=bpy.types.Object, poll=is_mesh, description="The mesh to move", update=_object_changed)
    open_area: FloatProperty(options={"HIDDEN"}, description="Of an open mesh when it was chosen (m²); 0 for a closed one")
    material: choice("Material", "What the body is made of", MATERIAL_ITEMS, BuildSettings.material)
    use_density: toggle("Density", "Replace the preset's density")
    density: number("Density (kg/m³)", 1000.0, "Kilograms per cubic metre", min=0.01, soft_max=20000.0, step=1000, precision=1)
    use_mass: toggle("Mass", "Give the mass of the whole body instead of its density")
    mass: number("Mass (kg)", 0.1, "Kilograms of the whole body", min=1e-6, soft_max=1000.0, step=1, precision=4)
    use_youngs_modulus: toggle("Stiffness", "Replace the preset's Young's modulus")
    youngs_modulus: number("Stiffness (Pa)", 1e5, "Young's modulus in pascals", min=1.0, soft_max=1e10, step=100000, precision=0)
    mass_scale: number(
        "Mass Factor", 1.0, "2 doubles the mass: half the acceleration in the same wind", min=0.001, soft_max=100.0, step=10, precision=3
    )
    stiffness_scale: number(
        "Stiffness Factor", 1.0, "Factor on Young's modulus: 2 is twice as stiff", min=0.001, soft_max=100.0, step=10, precision=3
    )
    pin_group: StringProperty(
        name="Pinned", update=changed,
        description="Vertex group whose vertices are held in place: weight 1 holds firmly, less draws back like a spring",
    )  # fmt: skip
    free_mode: choice("Holds of the Clip", "What becomes of the places at which the object was held in the clip", [
        ("KEEP", "Keep", "The object stays held where it was held in the clip"),
        ("ALL", "Let Go", "Nothing holds the object any more, but for its pinned vertices"),
        ("GROUP", "Let Go of a Group", "The vertices of a group are let go"),
    ])  # fmt: skip
    free_group: StringProperty(name="Freed", description="Vertex group of the vertices that are let go", update=changed)
    use_velocity: toggle("Velocity", "Start with a velocity of its own instead of at rest (or as recovered)")
    velocity: FloatVectorProperty(
        name="Velocity (m/s)", size=3, soft_min=-20.0, soft_max=20.0, step=10, description="At the start", update=changed
    )
    start_frame: IntProperty(
        name="Start Picture", default=0, min=0, description="The body stands still before this picture of the clip", update=changed
    )

    result: StringProperty(options={"HIDDEN"}, description="Name of the body in the last re-simulation")
    baked_copy: PointerProperty(type=bpy.types.Object, options={"HIDDEN"}, description="Carries the motion where the object itself cannot")


class SEEING_WIND_PG_collider(bpy.types.PropertyGroup):
    """Something that stands in the bodies' way and is not moved by them."""

    object: PointerProperty(
        name="Object", type=bpy.types.Object, poll=is_mesh, description="The mesh that the bodies collide with", update=changed
    )
    kind: choice("Contact", "What happens at its surface", KINDS)
    friction: number("Friction", 0.3, "Coulomb's coefficient: 0 is ice, 1 is rubber", min=0.0, soft_max=1.0, step=5, precision=2)


class EditOptions:
    """One edit: the scene has the one that is worked on, and keeps the others to compare with."""

    bodies: CollectionProperty(type=SEEING_WIND_PG_body)
    active_body: IntProperty(name="Active Body", default=0, min=0)
    colliders: CollectionProperty(type=SEEING_WIND_PG_collider)
    active_collider: IntProperty(name="Active Collider", default=0, min=0)
    use_floor: toggle("Floor", "A level floor under everything")
    floor_height: number("Height (m)", 0.0, "Of the floor, along world Z", soft_min=-10.0, soft_max=10.0, step=1, precision=3)
    floor_friction: number("Friction", 0.3, "Of the floor: 0 is ice, 1 is rubber", min=0.0, soft_max=1.0, step=5, precision=2)
    field_strength: number(
        "Field Strength", 1.0, "Factor on the recovered field; its keyframes count", options=KEPT | {"ANIMATABLE"},
        soft_min=-5.0, soft_max=5.0, step=10, precision=2,
    )  # fmt: skip
    edit_gravity_mode: choice("Gravity", "Gravity in the re-simulation", [
        ("SAME", "As Recovered", "The gravity that Recover was given"),
        ("NONE", "None", "No gravity"),
        ("CUSTOM", "Custom", "An acceleration of your own"),
    ])  # fmt: skip
    edit_gravity: FloatVectorProperty(
        name="Gravity (m/s²)", size=3, default=GRAVITY, soft_min=-20.0, soft_max=20.0, step=10, update=changed,
        description="Acceleration along world X, Y, Z in the re-simulation",
    )  # fmt: skip
    contact: BoolProperty(name="Contact", default=False, description="Bodies push each other; off: each moves alone", update=changed)
    offset: FloatVectorProperty(
        name="Offset (m)", size=3, soft_min=-10.0, soft_max=10.0, step=10, update=changed,
        description="Where this edit is shown, to stand beside another; it is simulated at the place that it was copied from",
    )  # fmt: skip

    edit_folder: StringProperty(options={"HIDDEN"})
    simulated_digest: StringProperty(options={"HIDDEN"})
    simulated_take: StringProperty(options={"HIDDEN"})
    baked_digest: StringProperty(options={"HIDDEN"})


class SEEING_WIND_PG_edit(EditOptions, bpy.types.PropertyGroup):
    """An edit that is kept while another one is worked on."""


def _switch_edit(self, context) -> None:
    from .edits import switch  # needs NumPy, which nobody has to wait for who has one edit

    switch(self)


class EditSettings:
    """The edits that are kept beside the one that is worked on."""

    edits: CollectionProperty(type=SEEING_WIND_PG_edit)
    active_edit: IntProperty(name="Active Edit", default=0, min=0, update=_switch_edit)
    loaded_edit: IntProperty(options={"HIDDEN"}, default=0, min=0, description="The edit whose settings the scene has now")


CLASSES = (SEEING_WIND_PG_body, SEEING_WIND_PG_collider, SEEING_WIND_PG_edit)
