"""The edit over the clip: camera background, holdout and shadow catcher, clean plate, light and compositor, in Blender 4.5 and 5.x.

The picture is put together from two layers. Behind is the clip, or, where the clip's own object was simulated anew and must not be seen
twice, the clean plate: the clip without it. In front is the render with a transparent film. The clip's object itself is a holdout when it
is still in the clip, so that what flies behind it is hidden by it; a floor, if wanted, catches shadows (Cycles only).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...engine.errors import SeeingWindError, UsageError
from ...engine.take import Take
from ..clip.clip_scene import picture_image
from ..clip.match import is_factory
from ..field.display import LEGEND_MARK
from ..job import takes
from ..job.worker import said_by
from .light import sun_of

TREE, SUN, FLOOR, PLATE = "Seeing Wind Composite", "Seeing Wind Sun", "Seeing Wind Floor", "Seeing Wind Clean Plate"
SUN_ANGLES = (math.radians(48.0), math.radians(-12.0), math.radians(-38.0))
"""High, over the camera's left shoulder: a guess to be turned to the clip's own light."""


@dataclass(frozen=True)
class Composite:
    """What was set up."""

    behind: str
    """"clip" or "plate"."""
    floor: bool
    light: str
    """What was done for want of a light; "" where the scene has its own."""
    shutter: float
    """Of the motion blur [frames]; 0: none."""

    def __str__(self) -> str:
        parts = ["the clip" if self.behind == "clip" else "the clean plate, since the clip's object moves anew"]
        parts += ["a floor that catches shadows"] * self.floor + [self.light] * bool(self.light)
        parts += [f"motion blur of {self.shutter:g} frames"] * bool(self.shutter)
        return f"Composite over {', '.join(parts)}"


def set_up(
    scene: bpy.types.Scene, *, plate: str = "AUTO", floor: bool = False, samples: int = 32, shutter: float = 0.5,
    show_field: bool = False,
) -> Composite:  # fmt: skip
    """Make a scene render its edit over the clip. May be called again after changes.

    Args:
        scene: with the results of a recovery.
        plate: CLIP, PLATE, or AUTO: the plate when the clip's object is part of the edit.
        floor: add a plane under everything that catches shadows.
        samples: of Cycles, per pixel.
        shutter: how long the camera's shutter was open [frames]: 0.5 is a shutter of 180 degrees; 0 renders no motion blur.
        show_field: render the arrows too.

    Raises:
        UsageError: without camera and clip, or without a plate where one is asked for.
    """
    settings, clip = scene.seeing_wind, scene.active_clip
    if scene.camera is None or clip is None:
        raise UsageError("The scene has no camera with a clip.", "Run Recover on a clip, or load the results of one.")
    again = any(body.is_recovered for body in settings.bodies)
    use_plate = plate == "PLATE" or (plate == "AUTO" and again)
    picture = _plate(settings) if use_plate else None
    recovered = settings.recovered_object
    if recovered is not None:
        recovered.hide_render, recovered.is_holdout, recovered.is_shadow_catcher = use_plate, not use_plate, False
    for helper in (settings.arrows_object, *_legends(scene)):
        if helper is not None:
            helper.hide_render = not show_field
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.render.film_transparent = samples, True
    scene.view_settings.view_transform = "Standard"
    scene.render.use_motion_blur = shutter > 0.0
    if shutter > 0.0:
        scene.render.motion_blur_shutter = shutter
    _background(scene.camera.data, clip)
    _floor(scene, floor)
    light = _light(scene)
    _compositor(scene, clip, picture)
    return Composite("plate" if use_plate else "clip", floor, light, shutter)


def is_set_up(scene: bpy.types.Scene) -> bool:
    """Whether the scene's compositor has our nodes."""
    tree = getattr(scene, "compositing_node_group", None) or getattr(scene, "node_tree", None)
    return tree is not None and any(node.get("seeing_wind") for node in tree.nodes)


def render(scene: bpy.types.Scene, path: Path, *, still: bool = False) -> None:
    """Render the whole range into a video (H.264 in MP4), or the current frame into a PNG. Without a window it waits.

    Raises:
        UsageError: when the clip begins before frame 0, where Blender renders nothing.
        SeeingWindError: when Blender could not write the file.
    """
    first = scene.seeing_wind.frame_start
    if first < 0 and not still:
        raise UsageError(
            f"The clip begins at frame {first}, and Blender renders videos from frame 0 on.", "Set First Frame to 1 and press Reload."
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    image, ffmpeg = scene.render.image_settings, scene.render.ffmpeg
    if hasattr(image, "media_type"):  # from Blender 5.0
        image.media_type = "IMAGE" if still else "VIDEO"
    image.file_format = "PNG" if still else "FFMPEG"
    if still:
        image.color_mode = "RGB"
    else:
        ffmpeg.format, ffmpeg.codec, ffmpeg.audio_codec = "MPEG4", "H264", "NONE"
        ffmpeg.constant_rate_factor, ffmpeg.ffmpeg_preset = "HIGH", "GOOD"
    scene.render.use_compositing, scene.render.use_sequencer = True, False
    scene.render.filepath, scene.render.use_file_extension = str(path), False
    call = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
    with bpy.context.temp_override(scene=scene):
        try:
            bpy.ops.render.render(call, animation=not still, write_still=still)
        except RuntimeError as error:
            raise SeeingWindError(f"Blender could not render {path}: {said_by(error)}.", "Check that the folder can be written.") from error


def _plate(settings: bpy.types.PropertyGroup) -> bpy.types.Image:
    take = Take(takes.shown(settings)) if settings.recovered_take else None
    if take is None or not take.file("observation.npz").is_file():
        raise UsageError("There is no clean plate.", "It comes from recovering a clip; use the clip itself as background.")
    plate = take.read_arrays("observation.npz").get("background")
    if plate is None or plate.ndim != 3:
        raise UsageError(f"{take.path} holds no clean plate.", "Run Recover again, or use the clip itself as background.")
    former = bpy.data.images.get(PLATE)
    if former is not None:
        bpy.data.images.remove(former)
    return picture_image(PLATE, plate)


def _legends(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    return [obj for obj in scene.objects if LEGEND_MARK in obj]


def _background(camera: bpy.types.Camera, clip: bpy.types.MovieClip) -> None:
    """The clip behind the camera, for the viewport."""
    camera.show_background_images = True
    if not any(each.clip == clip for each in camera.background_images):
        background = camera.background_images.new()
        background.source, background.clip, background.alpha = "MOVIE_CLIP", clip, 1.0
        background.display_depth, background.frame_method = "BACK", "STRETCH"


def _floor(scene: bpy.types.Scene, wanted: bool) -> None:
    obj = scene.objects.get(FLOOR)
    if obj is not None:
        # where the user has put it, it stays
        obj.hide_render = not wanted
        return
    if not wanted:
        return
    corners = _corners(scene)
    low, size = corners.min(axis=0), float(np.ptp(corners, axis=0).max()) or 1.0
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    mesh = bpy.data.meshes.new(FLOOR)
    reach = 4.0 * size
    mesh.from_pydata([(-reach, -reach, 0), (reach, -reach, 0), (reach, reach, 0), (-reach, reach, 0)], [], [(0, 1, 2, 3)])
    obj = bpy.data.objects.new(FLOOR, mesh)
    obj.location = (middle[0], middle[1], low[2])
    obj.is_shadow_catcher, obj.display_type = True, "WIRE"
    scene.collection.objects.link(obj)


def _corners(scene: bpy.types.Scene) -> np.ndarray:
    """Bounding boxes (8 N, 3) of what is rendered, over the clip's range."""
    settings, found, at = scene.seeing_wind, [], scene.frame_current
    bodies = [body.baked_copy or (settings.recovered_object if body.is_recovered else body.object) for body in settings.bodies]
    objects = [obj for obj in (*bodies, settings.recovered_object) if obj is not None]
    if not objects:
        raise UsageError("There is nothing to stand on a floor.", "Insert a mesh, or leave the floor out.")
    for frame in np.linspace(scene.frame_start, scene.frame_end, 5):
        scene.frame_set(int(frame))
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for obj in objects:
            evaluated = obj.evaluated_get(depsgraph)
            matrix = np.array(evaluated.matrix_world)
            found.append(np.array([corner[:] for corner in evaluated.bound_box]) @ matrix[:3, :3].T + matrix[:3, 3])
    scene.frame_set(at)
    return np.concatenate(found)


def _light(scene: bpy.types.Scene) -> str:
    """A sun and a pale sky where there is no light but Blender's default one; says what it did."""
    lights = [obj for obj in scene.objects if obj.type == "LIGHT"]
    default = [obj for obj in lights if is_factory(obj)]
    if len(lights) > len(default):
        return ""
    for obj in default:
        obj.hide_render = True
    said = "Blender's default light is off; " if default else ""
    seen = sun_of(scene.seeing_wind.recovered_object)
    said += "a sun from where the clip's object is brightest" if seen else "a sun: turn it to the clip's light"
    lamp = bpy.data.lights.new(SUN, "SUN")
    lamp.energy, lamp.angle = 2.6, math.radians(2.0)
    sun = bpy.data.objects.new(SUN, lamp)
    sun.rotation_euler = seen.to_track_quat("Z", "Y").to_euler() if seen else SUN_ANGLES
    scene.collection.objects.link(sun)
    if scene.world is None:
        scene.world = bpy.data.worlds.new("Seeing Wind Sky")
        scene.world.use_nodes = True
        sky = scene.world.node_tree.nodes.get("Background")
        sky.inputs["Color"].default_value, sky.inputs["Strength"].default_value = (0.66, 0.78, 1.0, 1.0), 0.55
    return said


def _compositor(scene: bpy.types.Scene, clip: bpy.types.MovieClip, plate: bpy.types.Image | None) -> None:
    """Clip or plate, under the render, into the output. Other nodes of the user's stay; ours are made anew."""
    tree, output = _tree(scene)
    for node in [node for node in tree.nodes if node.get("seeing_wind")]:
        tree.nodes.remove(node)

    def new(kind: str, column: int, row: int = 0) -> Any:
        node = tree.nodes.new(f"CompositorNode{kind}")
        node["seeing_wind"], node.location = True, (260 * column, -280 * row)
        return node

    if plate is None:
        behind = new("MovieClip", 0)
        behind.clip = clip
    else:
        behind = new("Image", 0)
        behind.image = plate
    scale, layers, over = new("Scale", 1), new("RLayers", 0, 1), new("AlphaOver", 2)
    if hasattr(scale, "space"):  # up to Blender 4.5
        scale.space, scale.frame_method = "RENDER_SIZE", "STRETCH"
        lower, upper = over.inputs[1], over.inputs[2]
    else:
        scale.inputs["Type"].default_value, scale.inputs["Frame Type"].default_value = "Render Size", "Stretch"
        lower, upper = over.inputs["Background"], over.inputs["Foreground"]
    layers.scene = scene
    tree.links.new(behind.outputs["Image"], scale.inputs["Image"])
    tree.links.new(scale.outputs["Image"], lower)
    tree.links.new(layers.outputs["Image"], upper)
    tree.links.new(over.outputs["Image"], output.inputs[0])
    output.location = (260 * 3, 0)


def _tree(scene: bpy.types.Scene) -> tuple[bpy.types.NodeTree, bpy.types.Node]:
    """The scene's compositor and its output node: `node_tree` with a Composite node up to 4.5, a node group with an output from 5.0."""
    if hasattr(scene, "compositing_node_group"):
        tree = scene.compositing_node_group
        if tree is None:
            tree = scene.compositing_node_group = bpy.data.node_groups.new(TREE, "CompositorNodeTree")
        if not any(item.item_type == "SOCKET" and item.in_out == "OUTPUT" for item in tree.interface.items_tree):
            tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        kind = "NodeGroupOutput"
    else:
        empty = scene.node_tree is None
        scene.use_nodes = True
        if empty:  # the two nodes that Blender puts in by itself
            scene.node_tree.nodes.clear()
        tree, kind = scene.node_tree, "CompositorNodeComposite"
    output = next((node for node in tree.nodes if node.bl_idname == kind), None) or tree.nodes.new(kind)
    return tree, output
