"""Set up and render the edit over the clip."""

import itertools
from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ...engine.errors import SeeingWindError
from ..clip.inputs.clips import is_footage
from ..direct_operator import DirectOperator
from ..job import takes
from ..property_kinds import PATH
from ..user_paths import absolute
from .own import samples_for
from .properties import LOOK, Look


class SEEING_WIND_OT_set_up_composite(Look, DirectOperator, bpy.types.Operator):
    """Set up camera background, holdout, shadow catcher, clean plate, light and compositor, so that a render shows the edit in the clip"""

    bl_idname = "seeing_wind.set_up_composite"
    bl_label = "Set Up Composite"

    hdri: StringProperty(
        name="HDRI", subtype="FILE_PATH", options=PATH, description="A panorama that lights the edit; not given: that of the scene"
    )

    def act(self, context):
        """Set the composite up, also repeatedly. Options not given come from the scene; options given are stored there."""
        settings = context.scene.seeing_wind
        look, hdri, samples = settings.composite, settings.hdri, settings.composite_samples
        former = {name: getattr(look, name) for name in LOOK}
        if self.properties.is_property_set("samples") and not self.options.is_repeat:
            settings.composite_samples = 0  # so that they count as new, even if unchanged since the last set-up
        for name in LOOK:
            source, target = (self, look) if self.properties.is_property_set(name) else (look, self)
            setattr(target, name, getattr(source, name))
        if self.properties.is_property_set("hdri"):
            settings.hdri = self.hdri
        try:
            done = _set_up(context.scene)
        except SeeingWindError:
            settings.hdri, settings.composite_samples = hdri, samples
            for name, value in former.items():
                setattr(look, name, value)
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
        """Render; first set up the composite if there is none, its settings have changed, or files of it are missing."""
        from . import composite, mattes, nodes  # need NumPy

        scene = context.scene
        former = scene.seeing_wind.composite_as  # "" if a script has set it up
        as_before = former in ("", _as_text(scene.seeing_wind)) and not (former and mattes.missing_matte(scene) is not None)
        if not nodes.is_set_up(scene) or not as_before:
            _set_up(scene)
        if self.filepath:
            path = Path(absolute(self.filepath))
        else:
            home = takes.shown(scene.seeing_wind).parent if scene.seeing_wind.recovered_take else Path(absolute("//"))
            path = _unshown(home / ("composite.png" if self.still else "composite.mp4"))
        composite.render(scene, path, still=self.still)
        return f"Rendered {path}" if bpy.app.background else f"Rendering into {path}"


def _unshown(path: Path) -> Path:
    """`path`, numbered if this .blend file uses it as footage: one shot's composite may be the next shot's clip."""
    names = (path.with_name(f"{path.stem}_{number}{path.suffix}") for number in itertools.count(2))
    return path if not is_footage(path) else next(name for name in names if not is_footage(name))


def _set_up(scene: bpy.types.Scene):
    """Set up the composite from the scene's settings, and record what was set up for the panel."""
    from .composite import set_up  # needs NumPy

    settings = scene.seeing_wind
    chosen = {name: getattr(settings.composite, name) for name in LOOK if name not in ("behind", "samples")}
    done = set_up(scene, plate=settings.composite.behind, samples=samples_for(scene), **chosen)
    settings.composite_said, settings.composite_as = str(done), _as_text(settings)
    settings.composite_samples = settings.composite.samples
    return done


def _as_text(settings: bpy.types.PropertyGroup) -> str:
    """Everything that determines the composite, as text. This includes the take: light, outlines, grain and softness come from it."""
    take = [Path(settings.recovered_take).name, settings.recovered_stamp]
    return repr([getattr(settings.composite, name) for name in LOOK] + [settings.hdri, settings.hdri_turn, settings.hdri_strength, *take])


CLASSES = (SEEING_WIND_OT_set_up_composite, SEEING_WIND_OT_render_composite)
