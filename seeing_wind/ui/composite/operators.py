"""The edit over the clip, set up and rendered."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty

from ...engine.errors import SeeingWindError
from ..direct_operator import DirectOperator
from ..job import takes
from ..property_kinds import PATH
from ..user_paths import absolute

BEHIND = [
    ("AUTO", "Automatic", "The clip, or the clean plate when the clip's own object is simulated anew"),
    ("CLIP", "Clip", "The clip as it is"),
    ("PLATE", "Clean Plate", "The clip, with its object covered by what was behind it"),
]


class SEEING_WIND_OT_set_up_composite(DirectOperator, bpy.types.Operator):
    """Set up camera background, holdout, shadow catcher, clean plate, light and compositor, so that a render shows the edit in the clip"""

    bl_idname = "seeing_wind.set_up_composite"
    bl_label = "Set Up Composite"

    behind: EnumProperty(name="Behind", items=BEHIND, description="What is seen behind the edit")
    floor: BoolProperty(name="Floor", description="A plane under the edit that catches its shadows; move it to where the clip's floor is")
    wall: BoolProperty(
        name="Wall", description="An upright plane behind the edit that catches its shadows; move and turn it to where the clip's wall is"
    )
    samples: IntProperty(name="Samples", default=32, min=1, soft_max=512, step=16, description="Of Cycles, per pixel")
    shutter: FloatProperty(
        name="Shutter (frames)", default=0.5, min=0.0, soft_max=1.0,
        description="How long the clip's shutter was open: 0.5 is a shutter of 180 degrees; 0 renders no motion blur",
    )  # fmt: skip
    grain: FloatProperty(
        name="Grain Factor", default=1.0, min=0.0, soft_max=2.0,
        description="Factor on the clip's own noise, which is measured and put on what is not the clip; 0 leaves it clean",
    )  # fmt: skip
    soft: FloatProperty(
        name="Softness Factor", default=1.0, min=0.0, soft_max=2.0,
        description="Factor on how softly the clip shows the object's rim, which is measured and given to the render; 0: Blender's filter",
    )  # fmt: skip
    fstop: FloatProperty(
        name="Aperture (f-stop)", default=0.0, min=0.0, soft_max=22.0, precision=1,
        description="Of the clip's lens, as on a sensor 36 mm wide: what is nearer or farther than the clip's object blurs; 0: none does",
    )  # fmt: skip
    show_field: BoolProperty(name="Show Arrows", description="Render the field's arrows too")
    hdri: StringProperty(
        name="HDRI", subtype="FILE_PATH", options=PATH, description="A panorama that lights the edit; not given: that of the scene"
    )

    def act(self, context):
        """May be repeated after any change."""
        from .composite import set_up  # needs NumPy

        settings = context.scene.seeing_wind
        former = settings.hdri
        if self.properties.is_property_set("hdri"):
            settings.hdri = self.hdri
        chosen = {name: getattr(self, name) for name in ("floor", "wall", "samples", "shutter", "grain", "soft", "fstop", "show_field")}
        try:
            done = set_up(context.scene, plate=self.behind, **chosen)
        except SeeingWindError:
            settings.hdri = former
            raise
        for wrong in done.warnings:
            self.report({"WARNING"}, wrong)
        return str(done)


class SEEING_WIND_OT_render_composite(DirectOperator, bpy.types.Operator):
    """Render the edit over the clip into a video"""

    bl_idname = "seeing_wind.render_composite"
    bl_label = "Render over Clip"
    bl_options = {"REGISTER"}

    filepath: StringProperty(
        name="To", subtype="FILE_PATH", options=PATH,
        description="MP4, or PNG for one frame; empty: `composite.mp4` beside the take",
    )  # fmt: skip
    still: BoolProperty(name="This Frame Only", options={"SKIP_SAVE"}, description="An image of the current frame instead of the video")

    def act(self, context):
        """Sets the composite up first when it has not been."""
        from . import composite, nodes  # needs NumPy

        scene = context.scene
        if not nodes.is_set_up(scene):
            composite.set_up(scene)
        if self.filepath:
            path = Path(absolute(self.filepath))
        else:
            home = takes.shown(scene.seeing_wind).parent if scene.seeing_wind.recovered_take else Path(absolute("//"))
            path = home / ("composite.png" if self.still else "composite.mp4")
        composite.render(scene, path, still=self.still)
        return f"Rendered {path}" if bpy.app.background else f"Rendering into {path}"


CLASSES = (SEEING_WIND_OT_set_up_composite, SEEING_WIND_OT_render_composite)
