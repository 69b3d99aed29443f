"""Which settings of a scene follow its clip: frame rate, range, size, colours, active camera. An existing shot is left alone.

In a fresh scene, all of them follow the clip. In any other, the user decides (`SEEING_WIND_OT_match_scene`); until then, only the active
camera follows, and only if the scene has none.
"""

from __future__ import annotations

from collections.abc import Collection

import bpy

PARTS = [
    ("FPS", "Frame Rate", "Frames per second of the clip: one scene frame is one clip frame"),
    ("RANGE", "Frame Range", "Begin with the clip's first frame and end with its last"),
    ("SIZE", "Resolution", "Size and shape of the clip's pixels"),
    ("VIEW", "Colors", "View transform Standard and a transparent film, so that the clip's colors come out as they went in"),
    ("CAMERA", "Active Camera", "Look through the camera that stands where the clip's did"),
]
ALL = frozenset(part for part, _, _ in PARTS)
FACTORY = {"Cube": "MESH", "Camera": "CAMERA", "Light": "LIGHT"}
"""Names and types of the objects in a new file."""
OURS = "seeing_wind_camera"
"""Custom property of the camera that stands where the clip's did."""


def is_factory(obj: bpy.types.Object) -> bool:
    """Whether an object is one of a new file's default objects, unchanged."""
    untouched = obj.animation_data is None and not obj.modifiers and not obj.constraints and obj.parent is None
    if FACTORY.get(obj.name) != obj.type or not untouched:
        return False
    place = tuple(round(value, 2) for value in obj.location)
    if obj.type == "MESH":
        sides = tuple(round(side, 3) for side in obj.dimensions)
        return place == (0.0, 0.0, 0.0) and len(obj.data.vertices) == 8 and sides == (2.0, 2.0, 2.0)
    if obj.type == "LIGHT":
        return place == (4.08, 1.01, 5.9) and obj.data.type == "POINT" and obj.data.energy == 1000.0
    return place == (7.36, -6.93, 4.96)


def is_fresh(scene: bpy.types.Scene) -> bool:
    """Whether a scene is like that of a new file: default settings, and no objects but default ones."""
    render = scene.render
    own = [obj for obj in scene.objects if not is_factory(obj)]
    as_new = (scene.frame_start, scene.frame_end, render.fps, render.fps_base) == (1, 250, 24, 1.0)
    return as_new and (render.resolution_x, render.resolution_y) == (1920, 1080) and not own


def followed(scene: bpy.types.Scene) -> frozenset[str]:
    """The parts that follow the clip; decided at the first call for a scene."""
    settings = scene.seeing_wind
    if not settings.follows_decided:
        settings.follows = set(ALL) if is_fresh(scene) else {"CAMERA"} - ({"CAMERA"} if scene.camera is not None else set())
        settings.follows_decided = True
    return frozenset(settings.follows)


def hide_default_cube(scene: bpy.types.Scene) -> str:
    """Hide a new file's default cube. Returns a note if it was visible until now, else ""."""
    layer = scene.view_layers[0]
    cube = layer.objects.get("Cube")
    if cube is None or not is_factory(cube) or cube in [body.object for body in scene.seeing_wind.bodies]:
        return ""
    cube.hide_render = True
    if cube.hide_get(view_layer=layer):
        return ""
    cube.hide_set(True, view_layer=layer)
    if layer.objects.active == cube:
        layer.objects.active = None
    return "Blender's default Cube stood in front of the clip: hidden, Alt H shows it again"


def left_alone(scene: bpy.types.Scene) -> str:
    """A note on the parts that do not follow the clip; "" if all do."""
    parts = followed(scene)
    names = [name.lower() for part, name, _ in PARTS if part not in parts]
    return f"the scene keeps its own {', '.join(names)} (Match Scene changes that)" if names else ""


def said_of_range(scene: bpy.types.Scene, first: int, last: int) -> str:
    """What to do if the scene's range does not overlap the clip's scene frames `first` to `last`; "" if it does."""
    if first <= scene.frame_end and last >= scene.frame_start:
        return ""
    return (
        f"The clip is at frames {first} to {last}, outside the scene's range of {scene.frame_start} to {scene.frame_end}. Set First Frame "
        "to where it begins in your shot, and press Reload."
    )


def follow(
    scene: bpy.types.Scene,
    parts: Collection[str],
    *,
    fps: float,
    first: int,
    last: int,
    size: tuple[int, int],
    aspect: tuple[float, float] | None,
    camera: bpy.types.Object | None,
) -> None:
    """Set the given parts of a scene to match the clip.

    Args:
        fps: frames per second of the clip.
        first, last: scene frames of its first and last clip frame.
        size: width and height [px].
        aspect: pixel aspect, x and y; None leaves it unchanged.
        camera: the clip's camera.
    """
    render = scene.render
    if "FPS" in parts:
        render.fps = max(1, round(fps))
        render.fps_base = render.fps / fps
    if "RANGE" in parts:
        scene.frame_start, scene.frame_end = first, last
        # a scene's own range cannot begin before 0; the preview range, which playback follows, can
        scene.use_preview_range = first < 0
        if scene.use_preview_range:
            scene.frame_preview_start, scene.frame_preview_end = first, last
    if "SIZE" in parts:
        render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
        if aspect is not None:
            render.pixel_aspect_x, render.pixel_aspect_y = aspect
    if "VIEW" in parts:
        render.film_transparent, scene.view_settings.view_transform = True, "Standard"
    if "CAMERA" in parts and camera is not None:
        scene.camera = camera
