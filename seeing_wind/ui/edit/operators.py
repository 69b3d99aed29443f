"""The edit: which meshes move in the recovered field, what is held, how heavy they are, what is in their way; and further edits."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, IntProperty, StringProperty

from ...engine.errors import UsageError
from ..direct_operator import DirectOperator
from ..job.worker import said_by
from ..property_kinds import KINDS, MATERIAL_ITEMS, PATH
from ..recover.shown import shows_field
from ..user_paths import absolute

IMPORTERS = {".obj": "obj_import", ".ply": "ply_import", ".stl": "stl_import"}

SAME = [("SAME", "As Recovered", "The material of the object in the clip"), *MATERIAL_ITEMS]


class SEEING_WIND_OT_insert_mesh(DirectOperator, bpy.types.Operator):
    """Let the selected meshes, a file's mesh or the clip's own object move in the recovered field"""

    bl_idname = "seeing_wind.insert_mesh"
    bl_label = "Insert Mesh"

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of a mesh object; empty: all selected ones")
    filepath: StringProperty(name="File", subtype="FILE_PATH", options=PATH, description="OBJ, PLY or STL to import and insert")
    recovered: BoolProperty(name="Recovered Object", options={"SKIP_SAVE"}, description="Insert the clip's own object")
    material: EnumProperty(name="Material", items=SAME, options={"SKIP_SAVE"}, description="What it is made of")
    mass_scale: FloatProperty(
        name="Mass Factor", default=1.0, min=0.001, soft_max=100.0, step=10, options={"SKIP_SAVE"}, description="2 doubles the mass"
    )
    pin_group: StringProperty(name="Pinned", options={"SKIP_SAVE"}, description="Vertex group whose vertices are held in place")
    start_frame: IntProperty(name="Start Picture", default=0, min=0, options={"SKIP_SAVE"}, description="The body stands still before it")
    density: FloatProperty(name="Density (kg/m³)", default=1000.0, min=0.01, options={"SKIP_SAVE"}, description="Instead of the material's")
    mass: FloatProperty(
        name="Mass (kg)", default=0.1, min=1e-6, options={"SKIP_SAVE"}, description="Of the whole body, instead of a density"
    )
    youngs_modulus: FloatProperty(
        name="Stiffness (Pa)", default=1e5, min=1.0, options={"SKIP_SAVE"}, description="Young's modulus, instead of the material's"
    )
    velocity: FloatVectorProperty(name="Velocity (m/s)", size=3, options={"SKIP_SAVE"}, description="At the start")

    def act(self, context):
        """Add one body per mesh."""
        settings = context.scene.seeing_wind
        if self.recovered and settings.recovered_object is None:
            raise UsageError("There is no recovered object.", "Run Recover first.")
        found = [settings.recovered_object] if self.recovered else self._meshes(context)
        # None stands for the clip's own object, however it was chosen
        meshes = [None if obj == settings.recovered_object else obj for obj in found]
        taken = {None if body.is_recovered else body.object for body in settings.bodies if body.is_recovered or body.object is not None}
        new = [obj for obj in meshes if obj not in taken]
        if not new:
            raise UsageError("These meshes are in the list already.", "Select others, or change them in the list.")
        for obj in new:
            body = settings.bodies.add()
            body.name, body.is_recovered, body.object = (obj.name if obj else "Recovered Object"), obj is None, obj
            body.material = settings.material if self.material == "SAME" else self.material
            body.mass_scale, body.pin_group, body.start_frame = self.mass_scale, self.pin_group, self.start_frame
            for name in ("density", "mass", "youngs_modulus", "velocity"):
                if self.properties.is_property_set(name):
                    setattr(body, f"use_{name}", True)
                    setattr(body, name, getattr(self, name))
        settings.active_body = len(settings.bodies) - 1
        return f"Inserted {', '.join(body.name for body in settings.bodies[-len(new) :])}"

    def _meshes(self, context) -> list:
        settings = context.scene.seeing_wind
        if self.filepath:
            found = _import(absolute(self.filepath))
        elif self.object:
            obj = context.scene.objects.get(self.object)
            if obj is None or obj.type != "MESH":
                raise UsageError(f"There is no mesh object {self.object!r} in the scene.", "Name one, or select it.")
            found = [obj]
        else:
            found = list(context.selected_objects)
        found = [obj for obj in found if obj.type == "MESH" and not shows_field(obj, settings)]
        if not found:
            given = self.filepath or self.object
            raise UsageError(f"{given} is no mesh that could move." if given else "No mesh is selected.", "Choose the meshes to move.")
        return found


class SEEING_WIND_OT_remove_body(DirectOperator, bpy.types.Operator):
    """Take the active body off the list; its object stays"""

    bl_idname = "seeing_wind.remove_body"
    bl_label = "Remove"

    def act(self, context):
        """Objects and keyframes are not touched."""
        settings = context.scene.seeing_wind
        index = _active(settings)
        name = settings.bodies[index].name
        settings.bodies.remove(index)
        settings.active_body = max(0, min(index, len(settings.bodies) - 1))
        return f"Removed {name} from the list"


class SEEING_WIND_OT_pin_vertices(DirectOperator, bpy.types.Operator):
    """Hold the vertices of a vertex group in place"""

    bl_idname = "seeing_wind.pin_vertices"
    bl_label = "Pin Vertices"

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of an inserted object; empty: the active body")
    vertex_group: StringProperty(name="Vertex Group", options={"SKIP_SAVE"}, description="Empty: the object's active group")

    def act(self, context):
        """Check that the group holds something, and note it."""
        from ..scene_mesh import FIRM, pinned_vertices  # needs NumPy

        settings = context.scene.seeing_wind
        body = settings.bodies[_active(settings, self.object)]
        obj = settings.recovered_object if body.is_recovered else body.object
        if obj is None:
            raise UsageError(f"The object of {body.name} is gone.", "Take it off the list, or undo its deletion.")
        if obj.mode == "EDIT":
            obj.update_from_editmode()
        active = obj.vertex_groups.active
        group = self.vertex_group or (active.name if active else "")
        _, weights = pinned_vertices(obj, context.evaluated_depsgraph_get(), group)
        body.pin_group = group
        soft = int((weights < FIRM).sum())
        return f"{len(weights)} vertices of {body.name} are held" + (f", {soft} of them softly" if soft else "")


class SEEING_WIND_OT_scale_mass(DirectOperator, bpy.types.Operator):
    """Set the mass of a body relative to its material: twice the mass accelerates half as much in the same wind"""

    bl_idname = "seeing_wind.scale_mass"
    bl_label = "Scale Mass"

    factor: FloatProperty(
        name="Mass Factor", default=2.0, min=0.001, soft_max=100.0, step=10, description="2 doubles the mass: half the acceleration"
    )
    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of an inserted object; empty: the active body")

    def act(self, context):
        """Noted for the next re-simulation."""
        settings = context.scene.seeing_wind
        body = settings.bodies[_active(settings, self.object)]
        body.mass_scale = self.factor
        return f"{body.name} has {self.factor:g} times its mass"


class SEEING_WIND_OT_scale_stiffness(DirectOperator, bpy.types.Operator):
    """Set the stiffness of a body relative to its material's Young's modulus"""

    bl_idname = "seeing_wind.scale_stiffness"
    bl_label = "Scale Stiffness"

    factor: FloatProperty(
        name="Stiffness Factor", default=2.0, min=0.001, soft_max=100.0, step=10, description="Of Young's modulus: 2 is twice as stiff"
    )
    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of an inserted object; empty: the active body")

    def act(self, context):
        """Noted for the next re-simulation."""
        settings = context.scene.seeing_wind
        body = settings.bodies[_active(settings, self.object)]
        body.stiffness_scale = self.factor
        return f"{body.name} is {self.factor:g} times as stiff as its material"


class SEEING_WIND_OT_free_recovered(DirectOperator, bpy.types.Operator):
    """Let go of the clip's object where it was held in the clip: everywhere, or at the vertices of a group"""

    bl_idname = "seeing_wind.free_recovered"
    bl_label = "Let Go"

    vertex_group: StringProperty(name="Vertex Group", options={"SKIP_SAVE"}, description="Of the recovered object; empty: everywhere")

    def act(self, context):
        """Noted for the next re-simulation; the object is inserted if it is not yet."""
        settings = context.scene.seeing_wind
        if settings.recovered_object is None:
            raise UsageError("There is no recovered object.", "Run Recover first.")
        if self.vertex_group:
            from ..scene_mesh import pinned_vertices  # needs NumPy

            pinned_vertices(settings.recovered_object, context.evaluated_depsgraph_get(), self.vertex_group)
        body = next((body for body in settings.bodies if body.is_recovered), None)
        if body is None:
            body = settings.bodies.add()
            body.name, body.is_recovered = "Recovered Object", True
        body.free_mode, body.free_group = ("GROUP" if self.vertex_group else "ALL"), self.vertex_group
        return f"{self.vertex_group or 'The whole object'} is let go"


class SEEING_WIND_OT_insert_collider(DirectOperator, bpy.types.Operator):
    """Let the bodies collide with the selected meshes, which they do not move"""

    bl_idname = "seeing_wind.insert_collider"
    bl_label = "Add Collider"

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of a mesh object; empty: all selected ones")
    kind: EnumProperty(name="Contact", items=KINDS, options={"SKIP_SAVE"}, description="What happens at its surface")
    friction: FloatProperty(
        name="Friction", default=0.3, min=0.0, soft_max=1.0, options={"SKIP_SAVE"}, description="Coulomb's coefficient: 0 is ice, 1 rubber"
    )

    def act(self, context):
        """One collider per mesh; what is a body of this edit cannot be one."""
        settings = context.scene.seeing_wind
        found = [context.scene.objects.get(self.object)] if self.object else list(context.selected_objects)
        taken = {each.object for each in (*settings.colliders, *settings.bodies)}
        meshes = [obj for obj in found if obj is not None and obj.type == "MESH"]
        new = [obj for obj in meshes if obj not in taken and not shows_field(obj, settings)]
        if not new:
            raise UsageError("There is no mesh to collide with.", "Select meshes that are neither bodies nor colliders of this edit.")
        for obj in new:
            collider = settings.colliders.add()
            collider.name, collider.object, collider.kind, collider.friction = obj.name, obj, self.kind, self.friction
        settings.active_collider = len(settings.colliders) - 1
        return f"Bodies collide with {', '.join(obj.name for obj in new)}"


class SEEING_WIND_OT_remove_collider(DirectOperator, bpy.types.Operator):
    """Take the active collider off the list; its object stays"""

    bl_idname = "seeing_wind.remove_collider"
    bl_label = "Remove Collider"

    def act(self, context):
        """Its object is not touched."""
        settings = context.scene.seeing_wind
        index = settings.active_collider
        if index >= len(settings.colliders):
            raise UsageError("There is no collider.", "Add one first.")
        name = settings.colliders[index].name
        settings.colliders.remove(index)
        settings.active_collider = max(0, min(index, len(settings.colliders) - 1))
        return f"Bodies no longer collide with {name}"


class SEEING_WIND_OT_duplicate_edit(DirectOperator, bpy.types.Operator):
    """Copy this edit with its objects and place it beside the original, to compare the two"""

    bl_idname = "seeing_wind.duplicate_edit"
    bl_label = "Duplicate Edit"

    def act(self, context):
        """The copy is worked on from now on; it is not simulated yet."""
        from .edits import duplicate  # needs NumPy

        return f"Working on {duplicate(context.scene)}"


class SEEING_WIND_OT_remove_edit(DirectOperator, bpy.types.Operator):
    """Forget this edit and work on the one beside it; objects and keyframes stay"""

    bl_idname = "seeing_wind.remove_edit"
    bl_label = "Remove Edit"

    def act(self, context):
        """Objects and keyframes are not touched."""
        from .edits import remove  # needs NumPy

        return f"Removed {remove(context.scene.seeing_wind)}"


def _active(settings: bpy.types.PropertyGroup, name: str = "") -> int:
    """Index of the body of that object, or of the active one. Raises UsageError when there is none."""
    if name:
        for index, body in enumerate(settings.bodies):
            if name == body.name or (body.object is not None and body.object.name == name):
                return index
        raise UsageError(f"{name!r} is not inserted.", "Insert it first.")
    if settings.active_body < len(settings.bodies):
        return settings.active_body
    raise UsageError("No mesh is inserted.", "Insert one first.")


def _import(path: str) -> list[bpy.types.Object]:
    importer = IMPORTERS.get(Path(path).suffix.lower())
    if importer is None:
        raise UsageError(f"{path} is no OBJ, PLY or STL file.", "Import it by File > Import and insert the selected object.")
    if not Path(path).is_file():
        raise UsageError(f"There is no file {path}.", "Choose another one.")
    before = set(bpy.data.objects)
    try:
        getattr(bpy.ops.wm, importer)(filepath=path)
    except RuntimeError as error:
        raise UsageError(f"Blender cannot import {path}: {said_by(error)}.", "Choose another file.") from error
    return [obj for obj in bpy.data.objects if obj not in before and obj.type == "MESH"]


CLASSES = (
    SEEING_WIND_OT_insert_mesh, SEEING_WIND_OT_remove_body, SEEING_WIND_OT_pin_vertices, SEEING_WIND_OT_scale_mass,
    SEEING_WIND_OT_scale_stiffness, SEEING_WIND_OT_free_recovered, SEEING_WIND_OT_insert_collider, SEEING_WIND_OT_remove_collider,
    SEEING_WIND_OT_duplicate_edit, SEEING_WIND_OT_remove_edit,
)  # fmt: skip
