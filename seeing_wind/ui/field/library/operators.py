"""Operators that add a wind from the library, and list the library in Blender's preferences."""

import bpy
from bpy.props import BoolProperty, EnumProperty

from ....engine.errors import UsageError
from ...direct_operator import DirectOperator
from . import shelf

LIBRARY = "Seeing Wind"
"""Name of the library in the preferences."""


def choices(_self, _context):
    """Items of the menu of winds. Blender requires that their texts are kept alive, so they are kept in `_kept`."""
    return _items(shelf.entries(shelf.SHELF))


def _items(entries):
    if entries not in _kept:
        _kept[entries] = [(each.name, each.name, each.description) for each in entries] or [("NONE", "None", "The library is empty")]
    return _kept[entries]


_kept: dict = {}


class SEEING_WIND_OT_add_wind(DirectOperator, bpy.types.Operator):
    """Add a recovered wind to the scene, at the 3D cursor, and let what has physics here feel it"""

    bl_idname = "seeing_wind.add_wind"
    bl_label = "Add Wind"

    wind: EnumProperty(name="Wind", items=choices, description="Which wind of the library")
    calibrate: BoolProperty(
        name="Calibrate All Objects", default=True,
        description="Let all particles, hair, cloth and rigid bodies of the scene feel it as real matter does",
    )  # fmt: skip

    def act(self, context):
        """Append the wind at the 3D cursor, select it, and calibrate all objects if asked to."""
        from ..solvers.apart import keep_apart, other_kind
        from ..solvers.calibration import has_solver  # needs NumPy

        scene = context.scene
        field = shelf.take_down(scene, context.collection or scene.collection, shelf.SHELF, self.wind)
        field.location = scene.cursor.location
        for obj in context.selected_objects:
            obj.select_set(False)
        context.view_layer.objects.active = field
        field.select_set(True)
        if self.calibrate and any(has_solver(obj) for obj in scene.objects if obj != field):
            bpy.ops.seeing_wind.calibrate(every=True, field=field.name)
            left = sorted(other.name for other in other_kind(scene, field))
            instead = f", and not {', '.join(left[:3])}: one weight cannot suit forces and winds" if left else ""
            return f"Added {field.name}; what has physics feels it{instead}"
        keep_apart(scene)
        return f"Added {field.name}; Calibrate lets an object feel it"


class SEEING_WIND_OT_add_wind_library(DirectOperator, bpy.types.Operator):
    """List the recovered winds that come with the extension in Blender's Asset Browser, to be dragged into any scene"""

    bl_idname = "seeing_wind.add_wind_library"
    bl_label = "Show in Asset Browser"
    bl_options = {"REGISTER"}

    def act(self, context):
        """List the library. Its winds are appended, not linked, as calibration needs data local to the file."""
        if not shelf.entries(shelf.SHELF):
            raise UsageError("This copy of the extension has no wind library.", "Build it with `make winds`.")
        if shelf.listed() is not None:
            return f"The Asset Browser lists it as {shelf.listed().name}"
        library = context.preferences.filepaths.asset_libraries.new(name=LIBRARY, directory=str(shelf.SHELF))
        library.import_method = "APPEND"
        context.preferences.is_dirty = True
        return f"The Asset Browser lists it as {library.name}"


CLASSES = (SEEING_WIND_OT_add_wind, SEEING_WIND_OT_add_wind_library)
