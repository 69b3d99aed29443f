"""The edit over the clip: camera background, holdout and shadow catcher, clean plate, light and compositor, in Blender 4.5 and 5.x.

The image is put together from two layers. Behind is the clip, or, where the clip's own object was simulated anew and must not be seen
twice, the moving plate: the clip with the clean plate over the object's outline. In front is the render with a transparent film, with the
clip's grain. Where the object is still in the clip, a card at its distance with its outline cuts what flies behind it; floor, wall and
obstacles catch shadows (Cycles only).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ...engine.errors import SeeingWindError, UsageError
from ...engine.take import Take
from ..clip.clip_scene import frame_image
from ..clip.inputs.clips import check_film, refuse_footage
from ..clip.inputs.pace import pace_of_scene
from ..field.display import LEGEND_MARK, SURE
from ..job.worker import said_by
from ..scene_units import metres_per_unit
from . import nodes
from .catchers import set_catchers
from .film import drop_lenses, grain_of, lens_of, set_focus, softness_of
from .hdri import check_hdri
from .light import light_scene
from .mattes import IMAGE, Mattes, check_mattes, mattes_of, set_card
from .overscan import set_overscan
from .own import camera_changes, drop_unused, said_of_render, set_output, set_render
from .parts import background_of, check_parts, depths_of, plate_of, refuse, take_of

PLATE = "Seeing Wind Clean Plate"
ASTRAY = 0.01
"""Metres, and radians of turn or of view, by which a camera may differ from the clip's and still be taken for it."""

SQUEEZED = 0.03
"""Relative difference of shape that shows: whole pixels of small frames make two hundredths."""
USUAL_FILTER, SHARPEST, SOFTEST = 1.5, 0.25, 2.5
"""Width [px] of Cycles' usual filter, Blackman and Harris's; standard deviations [px] of its Gaussian one: above the first it is softer
than that, and the second is all that its width, four times as much, can be."""


@dataclass(frozen=True)
class Composite:
    """What was set up."""

    behind: str
    """"clip", "plate" (a still frame), or "moving plate"."""
    catchers: tuple[str, ...]
    """What catches shadows, in words."""
    held_out: str
    """What cuts the edit where the object stands before it: "outline", "body", or "" where the object is not in the frame."""
    bent: bool
    """Whether the clip's lens bends straight lines, and with it what is rendered."""
    grain: float
    """Of the clip, on what is rendered: standard deviation of display values in 0..1."""
    softness: float
    """Of the render, as the clip's: standard deviation of the blur [pixels of the render]; 0: Blender's own filter."""
    light: str
    """What lights it for want of a light of the user's; "" where the scene has its own."""
    shutter: float
    """Of the motion blur [frames]; 0: none."""
    fstop: float
    """Of the depth of field; 0: none."""
    astray: str
    """That the camera stands elsewhere than the clip's did, and what to do; "" where it does not."""
    changed: tuple[str, ...]
    """What of the camera and of the scene's render settings is otherwise now, in words."""
    lacking: tuple[str, ...]
    """What the engine and the colors that the scene keeps take away."""

    @property
    def warnings(self) -> list[str]:
        """What is wrong with it."""
        return [each for each in (self.astray, *self.lacking) if each]

    def __str__(self) -> str:
        parts = ["the clip" if self.behind == "clip" else f"the {self.behind}, since the clip's object moves anew"]
        parts += [*self.catchers, *[self.light] * bool(self.light)]
        parts += [f"what flies behind the object is cut by its {self.held_out}"] * bool(self.held_out)
        parts += ["bent as by the clip's lens"] * self.bent
        parts += [f"grain of {100.0 * self.grain:.1f} %"] * bool(self.grain)
        parts += [f"as soft as the clip ({self.softness:.1f} pixels)"] * bool(self.softness)
        parts += [f"motion blur of {self.shutter:g} frames"] * bool(self.shutter)
        parts += [f"depth of field at f/{self.fstop:g}"] * bool(self.fstop)
        changed = f". Changed: {', '.join(self.changed)}" if self.changed else ""
        return " ".join([*self.warnings, f"Composite over {', '.join(parts)}{changed}"])


def set_up(
    scene: bpy.types.Scene, *, plate: str = "AUTO", floor: bool = False, wall: bool = False, samples: int | None = 32, shutter: float = 0.5,
    grain: float = 1.0, soft: float = 1.0, fstop: float = 0.0, show_field: bool = False, use_cycles: bool = True, use_standard: bool = True,
) -> Composite:  # fmt: skip
    """Make a scene render its edit over the clip. May be called again after changes.

    Args:
        scene: with the results of a recovery.
        plate: CLIP, PLATE, or AUTO: the plate when the clip's object is part of the edit.
        floor, wall: add a plane under, or behind, everything that catches shadows; obstacles of the edit always do.
        samples: of Cycles, per pixel; None leaves the scene's own.
        shutter: how long the camera's shutter was open [frames]: 0.5 is a shutter of 180 degrees; 0 renders no motion blur.
        grain, soft: factors on the clip's own noise and blur, which are measured.
        fstop: of the clip's lens, which is focused on its object; 0 leaves everything sharp.
        show_field: render the arrows too.
        use_cycles, use_standard: change the scene's engine to Cycles, and its view transform to Standard.

    Raises:
        SeeingWindError: what `check_parts` finds missing, all of it; a composite that is set up already stays as it is.
    """
    settings, clip = scene.seeing_wind, scene.active_clip
    again = any(body.is_recovered for body in settings.bodies)
    use_plate = plate == "PLATE" or (plate == "AUTO" and again)
    check_parts(scene, use_plate, fstop)
    take = take_of(settings)
    plate_image = frame_image(PLATE, plate_of(take)) if use_plate else None
    # what is written into the take comes before anything of the scene is changed
    mattes, depths = mattes_of(scene, take) if take is not None else None, depths_of(take)
    lens = lens_of(take, tuple(clip.size)) if take is not None else None
    changed = camera_changes(scene, fstop)
    set_focus(scene, depths, fstop, pace_of_scene(scene))
    held_out = _hold_out(scene, depths, mattes, use_plate)
    for helper in [obj for obj in scene.objects if SURE in obj or LEGEND_MARK in obj]:  # arrows and their legends
        helper.hide_render = not show_field
    changed += set_render(scene, use_cycles, use_standard, samples)
    scene.render.use_motion_blur = shutter > 0.0
    if shutter > 0.0:
        scene.render.motion_blur_shutter = shutter
    _background(scene.camera.data, clip)
    catchers = set_catchers(scene, floor, wall)
    light = light_scene(scene, background_of(take))
    noise = grain * grain_of(take) if take is not None else 0.0
    softness = _soften(scene, take, soft)
    rendered = set_overscan(scene, 1.0 if lens is None else lens.wider)
    nodes.build(scene, clip, plate_image, mattes, noise, lens, rendered)
    for name in (PLATE, IMAGE):
        drop_unused(bpy.data.images, name)
    drop_lenses()
    behind = "clip" if not use_plate else "plate" if mattes is None else "moving plate"
    return Composite(
        behind, tuple(catchers), held_out, lens is not None, noise, softness, light, shutter, fstop, astray(scene),
        tuple(changed), tuple(said_of_render(scene)),
    )


def render(scene: bpy.types.Scene, path: Path, *, still: bool = False) -> None:
    """Render the whole range into a video (H.264 in MP4), or the current frame into a PNG. Without a window it waits.

    The scene has its own output settings again when it is done.

    Raises:
        UsageError: when the clip begins before frame 0, where Blender renders nothing, its file, a matte or the panorama is gone, `path` is
            footage, the scene renders several views, or Blender is rendering already; all of it, where there is more than one of these.
        SeeingWindError: when Blender could not write the file.
    """
    if bpy.app.is_job_running("RENDER"):
        raise UsageError("Blender is rendering already.", "Wait for it, or stop it with Esc in its window.")
    refuse(
        lambda: check_film(scene.active_clip), lambda: refuse_footage(path), lambda: check_hdri(scene), lambda: check_mattes(scene),
        lambda: _check_output(scene, still),
    )  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    give_back, running = set_output(scene, path, still), False
    call = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
    with bpy.context.temp_override(scene=scene):
        try:
            running = "RUNNING_MODAL" in bpy.ops.render.render(call, animation=not still, write_still=still)
        except RuntimeError as error:
            raise SeeingWindError(f"Blender could not render {path}: {said_by(error)}.", "Check that the folder can be written.") from error
        finally:
            if not running:
                give_back()


def _check_output(scene: bpy.types.Scene, still: bool) -> None:
    """UsageError for a scene of which Blender renders no image per frame, or, for a video, not all frames."""
    first = scene.seeing_wind.frame_start
    if scene.render.use_multiview:
        raise UsageError(
            "Stereoscopy is on, which renders an image for each eye, and the clip has one.", "Switch it off (Properties > Output)."
        )
    if first < 0 and not still:
        raise UsageError(
            f"The clip begins at frame {first}, and Blender renders videos from frame 0 on.", "Set First Frame to 1 and press Reload."
        )


def astray(scene: bpy.types.Scene) -> str:
    """Whether the scene is rendered in another shape than the clip, or by a camera elsewhere, in the current frame; in words, "" for no.

    Its background is stretched to any camera, so that nobody sees it at once.
    """
    camera, clips, clip, to = scene.camera, scene.seeing_wind.camera_object, scene.active_clip, scene.render
    shape = to.resolution_x * to.pixel_aspect_x / (to.resolution_y * to.pixel_aspect_y)
    if clip is not None and clip.size[0] and abs(shape * clip.size[1] / clip.size[0] - 1.0) > SQUEEZED:
        return f"The clip is squeezed into a frame of another shape: set the resolution to {clip.size[0]} x {clip.size[1]}."
    if camera is None or clips is None or camera == clips or scene not in clips.users_scene:
        return ""
    away = np.array(clips.matrix_world.normalized().inverted_safe() @ camera.matrix_world.normalized()) - np.eye(4)
    angles = abs(camera.data.angle - clips.data.angle)
    if max(np.abs(away[:3, :3]).max(), angles) < ASTRAY and np.abs(away[:3, 3]).max() * metres_per_unit(scene) < ASTRAY:
        return ""
    return f"{camera.name} is not where the clip's camera was, so nothing stands where it belongs: make {clips.name} the active camera."


def _hold_out(scene: bpy.types.Scene, depths: np.ndarray | None, mattes: Mattes | None, hidden: bool) -> str:
    """Let the object that is in the clip hide what flies behind it; returns by what, as `Composite.held_out`.

    Args:
        depths: as of `depths_of`.
        mattes: None for a take without outlines; then the body does it.
        hidden: the plate covers the object.
    """
    obj, card = scene.seeing_wind.recovered_object, mattes if depths is not None and not hidden else None
    set_card(scene, card, [] if depths is None else depths)
    if obj is None:
        return ""
    by_body = not hidden and card is None
    obj.hide_render, obj.is_holdout, obj.is_shadow_catcher = not by_body, by_body, False
    return "" if hidden else "body" if by_body else "outline"


def _soften(scene: bpy.types.Scene, take: Take | None, factor: float) -> float:
    """Let Cycles film as softly as the clip is times a factor; returns how softly [pixels of the render], 0 for Blender's usual filter."""
    seen = take.read_arrays("observation.npz").get("image") if take is not None and take.file("observation.npz").is_file() else None
    softness, cycles = 0.0, scene.cycles
    if take is not None and seen is not None:
        size = scene.render.resolution_x * scene.render.resolution_percentage / 100.0 / seen.shape[1]
        softness = min(factor * softness_of(take) * size, SOFTEST)
    if softness <= SHARPEST:
        cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", USUAL_FILTER
        return 0.0
    cycles.pixel_filter_type, cycles.filter_width = "GAUSSIAN", 4.0 * softness
    return softness


def _background(camera: bpy.types.Camera, clip: bpy.types.MovieClip) -> None:
    """The clip behind the camera, for the viewport."""
    camera.show_background_images = True
    if not any(each.clip == clip for each in camera.background_images):
        background = camera.background_images.new()
        background.source, background.clip, background.alpha = "MOVIE_CLIP", clip, 1.0
        background.display_depth, background.frame_method = "BACK", "STRETCH"
