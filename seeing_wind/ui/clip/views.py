"""Further views: other cameras that saw the object at the same time."""

import bpy
from bpy.props import StringProperty

from ...engine.errors import UsageError
from ..direct_operator import DirectOperator
from ..property_kinds import PATH


class SEEING_WIND_OT_add_view(DirectOperator, bpy.types.Operator):
    """Add a further synchronised view of the object, which tells its motion along the first camera's view"""

    bl_idname = "seeing_wind.add_view"
    bl_label = "Add View"

    clip: StringProperty(name="Clip", subtype="FILE_PATH", options=PATH, description="The other camera's video")
    camera: StringProperty(name="Camera File", subtype="FILE_PATH", options=PATH, description="JSON of that camera")
    mask: StringProperty(name="Mask", subtype="FILE_PATH", options=PATH, description="PNG of that view's first frame")

    def act(self, context):
        """Add the view; its files can be chosen afterwards."""
        settings = context.scene.seeing_wind
        view = settings.views.add()
        view.clip, view.camera, view.mask = self.clip, self.camera, self.mask
        settings.active_view = len(settings.views) - 1
        return f"View {len(settings.views) + 1} is there"


class SEEING_WIND_OT_remove_view(DirectOperator, bpy.types.Operator):
    """Take the active further view off the list"""

    bl_idname = "seeing_wind.remove_view"
    bl_label = "Remove View"

    def act(self, context):
        """Remove the view from the list, but not its files from disk."""
        settings = context.scene.seeing_wind
        index = settings.active_view
        if index >= len(settings.views):
            raise UsageError("There is no further view.", "Add one first.")
        settings.views.remove(index)
        settings.active_view = max(0, min(index, len(settings.views) - 1))
        return f"Removed view {index + 2}"


CLASSES = (SEEING_WIND_OT_add_view, SEEING_WIND_OT_remove_view)
