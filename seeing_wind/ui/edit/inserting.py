"""Operators that put meshes into the edit: as bodies, which move in the recovered field, and as colliders, which stand in their way."""

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...engine.errors import UsageError
from ...engine.materials import SHEETS
from ...engine.settings import BodyEdit, ColliderEdit
from ..bake.plan import take_back
from ..direct_operator import DirectOperator
from ..option_properties import give, panel_options, with_options
from ..property_kinds import MATERIAL_ITEMS, PATH
from ..recover.shown import shows_field
from ..user_paths import absolute
from .cloth_look import dress
from .importing import import_meshes
from .sheet_label import is_shell

HERE = {"options": {"SKIP_SAVE"}, "update": None}
"""Arguments for operator properties that are not stored in the scene."""

SAME = [("SAME", "As Recovered", "The material of the object in the clip", len(MATERIAL_ITEMS)), *MATERIAL_ITEMS]


@with_options(BodyEdit, ticks=False, **HERE)
class SEEING_WIND_OT_insert_mesh(DirectOperator, bpy.types.Operator):
    """Let the selected meshes, a file's mesh or the clip's own object move in the recovered field"""

    bl_idname = "seeing_wind.insert_mesh"
    bl_label = "Insert Mesh"

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of a mesh object; empty: all selected ones")
    filepath: StringProperty(name="File", subtype="FILE_PATH", options=PATH, description="OBJ, PLY or STL to import and insert")
    recovered: BoolProperty(name="Recovered Object", options={"SKIP_SAVE"}, description="Insert the clip's own object")
    material: EnumProperty(name="Material", items=SAME, options={"SKIP_SAVE"}, description="What it is made of")
    pin_group: StringProperty(name="Pinned", options={"SKIP_SAVE"}, description="Vertex group whose vertices are held in place")

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
        material, dressed = settings.material if self.material == "SAME" else self.material, []
        self._refuse_unfit([obj for obj in new if obj is not None], context.scene, material in SHEETS)
        for obj in new:
            body = settings.bodies.add()
            body.name, body.is_recovered, body.object = (obj.name if obj else "Recovered Object"), obj is None, obj
            take_back(body, obj or settings.recovered_object, context.scene)
            body.material = material
            body.pin_group = self.pin_group
            for one in panel_options(BodyEdit):
                if one.name != "material" and self.properties.is_property_set(one.identifier):
                    give(body, one, getattr(self, one.identifier))
            if is_shell(body) and dress(obj, body.material):
                dressed.append(obj.name)
        settings.active_body = len(settings.bodies) - 1
        said = f"; {', '.join(dressed)} had no material and looks like thin cloth now" if dressed else ""
        return f"Inserted {', '.join(body.name for body in settings.bodies[-len(new) :])}{said}"

    def _refuse_unfit(self, meshes: list, scene, sheet: bool) -> None:
        """Raise UsageError for meshes that Re-simulate could not write, and remove them again if they were imported for this."""
        from ..bake.at_rest import discard  # both need NumPy
        from .resimulate.edit_export import refuse_unfit

        try:
            refuse_unfit(meshes, scene, sheet=sheet)
        except UsageError:
            for obj in meshes if self.filepath else ():
                discard(obj)
            raise

    def _meshes(self, context) -> list:
        settings = context.scene.seeing_wind
        if self.filepath:
            found = import_meshes(absolute(self.filepath))
        elif self.object:
            obj = context.scene.objects.get(self.object)
            if obj is None:
                raise UsageError(f"There is no object {self.object!r} in the scene.", "Name a mesh object, or select it.")
            if obj.type != "MESH":
                raise UsageError(f"{obj.name} is no mesh but a {obj.type.lower()}.", "Convert it (Object > Convert > Mesh).")
            found = [obj]
        else:
            found = list(context.selected_objects)
        found = [obj for obj in found if obj.type == "MESH" and not shows_field(obj, settings)]
        if not found:
            given = self.filepath or self.object
            raise UsageError(f"{given} is no mesh that could move." if given else "No mesh is selected.", "Choose the meshes to move.")
        return found


@with_options(ColliderEdit, **HERE)
class SEEING_WIND_OT_insert_collider(DirectOperator, bpy.types.Operator):
    """Let the bodies collide with the selected meshes, which they do not move"""

    bl_idname = "seeing_wind.insert_collider"
    bl_label = "Add Collider"

    object: StringProperty(name="Object", options={"SKIP_SAVE"}, description="Name of a mesh object; empty: all selected ones")

    def act(self, context):
        """Add one collider per mesh; a body of this edit cannot be a collider."""
        from .resimulate.edit_export import refuse_unfit  # needs NumPy

        settings = context.scene.seeing_wind
        found = [context.scene.objects.get(self.object)] if self.object else list(context.selected_objects)
        taken = {each.object for each in (*settings.colliders, *settings.bodies)}
        meshes = [obj for obj in found if obj is not None and obj.type == "MESH"]
        new = [obj for obj in meshes if obj not in taken and not shows_field(obj, settings)]
        if not new:
            there = ", ".join(obj.name for obj in meshes if obj in taken)
            raise UsageError(
                f"There is no mesh to collide with{f': {there} is in this edit already' if there else ''}.",
                "Select meshes that are neither bodies nor colliders of this edit.",
            )
        refuse_unfit(new, context.scene, collide=True)
        for obj in new:
            collider = settings.colliders.add()
            collider.name, collider.object = obj.name, obj
            for one in panel_options(ColliderEdit):
                give(collider, one, getattr(self, one.identifier))
        settings.active_collider = len(settings.colliders) - 1
        return f"Bodies collide with {', '.join(obj.name for obj in new)}"


CLASSES = (SEEING_WIND_OT_insert_mesh, SEEING_WIND_OT_insert_collider)
