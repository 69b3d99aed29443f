"""The edit over the clip: camera background, holdout and shadow catcher, clean plate, light and compositor, in Blender 4.5 and 5.x.

The image has two layers. The background is the clip or, if the clip's own object was re-simulated and must not appear twice, the moving
plate: the clip with the clean plate over the object's outline. In front of it is the render, with a transparent film and the clip's grain.
If the object is still visible in the clip, a holdout card at its distance, cut to its outline, hides what passes behind it; floor, wall and
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
    """A record of what was set up."""

    behind: str
    """"clip", "plate" (a still frame), or "moving plate"."""
    catchers: tuple[str, ...]
    """The shadow catchers, in words."""
    held_out: str
    """What hides the edit behind the clip's object: "outline", "body", or "" if the object is not visible in the background."""
    bent: bool
    """Whether the render is distorted like the clip's lens."""
    grain: float
    """Grain of the clip added to the render: standard deviation of display values in 0..1."""
    softness: float
    """Blur of the render, matched to the clip: standard deviation [pixels of the render]; 0: Blender's default filter."""
    light: str
    """The light that was set up, in words; "" if the scene is lit by the user's own lights."""
    shutter: float
    """Shutter time of the motion blur [frames]; 0: none."""
    fstop: float
    """F-stop of the depth of field; 0: none."""
    astray: str
    """A warning if frame or camera do not match the clip's, and what to do; see `astray`. "" if they match."""
    changed: tuple[str, ...]
    """Changes of the camera's and the scene's render settings, in words."""
    lacking: tuple[str, ...]
    """What the composite lacks because the scene keeps its render engine or view settings."""

    @property
    def warnings(self) -> list[str]:
        """What is wrong with the composite."""
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
        plate: background: CLIP, PLATE, or AUTO, which takes the plate if the clip's object is part of the edit.
        floor, wall: add a shadow catcher below, or behind, everything; obstacles of the edit always catch shadows.
        samples: Cycles samples per pixel; None keeps the scene's.
        shutter: time that the camera's shutter was open [frames]: 0.5 is a 180-degree shutter; 0 renders no motion blur.
        grain, soft: factors on the measured noise and blur of the clip.
        fstop: of the clip's lens, which focuses on the clip's object; 0 renders everything sharp.
        show_field: render the arrows too.
        use_cycles, use_standard: change the scene's engine to Cycles, and its view transform to Standard.

    Raises:
        SeeingWindError: everything that `check_parts` finds missing; an existing composite is then unchanged.
    """
    settings, clip = scene.seeing_wind, scene.active_clip
    again = any(body.is_recovered for body in settings.bodies)
    use_plate = plate == "PLATE" or (plate == "AUTO" and again)
    check_parts(scene, use_plate, fstop)
    take = take_of(settings)
    plate_image = frame_image(PLATE, plate_of(take)) if use_plate else None
    # files are written into the take before the scene is changed
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
    """Render the whole range to a video (H.264 in MP4), or the current frame to a PNG. Without a window, returns when the render is done.

    The scene's output settings are restored after the render.

    Raises:
        UsageError: when Blender is already rendering; otherwise all of these that apply: a video's clip begins before frame 0, where
            Blender renders nothing; the clip's file, a matte or the panorama is missing; `path` is footage; the scene uses stereoscopy.
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
    """Raise UsageError if the scene renders more than one image per frame or, for a video, begins before frame 0."""
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
    """A warning if the render's aspect ratio differs from the clip's, or the camera from the clip's in the current frame; else "".

    The mistake is easy to miss, since the background is stretched to any camera.
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
    """Make the clip's object hide what passes behind it. Returns how, as `Composite.held_out`.

    Args:
        depths: of `depths_of`.
        mattes: None for a take without outlines; then the recovered object's mesh is the holdout.
        hidden: whether the plate covers the object, so that it must hide nothing.
    """
    obj, card = scene.seeing_wind.recovered_object, mattes if depths is not None and not hidden else None
    set_card(scene, card, [] if depths is None else depths)
    if obj is None:
        return ""
    by_body = not hidden and card is None
    obj.hide_render, obj.is_holdout, obj.is_shadow_catcher = not by_body, by_body, False
    return "" if hidden else "body" if by_body else "outline"


def _soften(scene: bpy.types.Scene, take: Take | None, factor: float) -> float:
    """Blur the Cycles render like the clip, times a factor. Returns the blur [pixels of the render]; 0 for Blender's default filter."""
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
    """Add the clip to the camera's background images, for the viewport."""
    camera.show_background_images = True
    if not any(each.clip == clip for each in camera.background_images):
        background = camera.background_images.new()
        background.source, background.clip, background.alpha = "MOVIE_CLIP", clip, 1.0
        background.display_depth, background.frame_method = "BACK", "STRETCH"
