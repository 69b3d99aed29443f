"""A wider render than the clip's frame, for a lens whose distortion shows points beyond the borders of the undistorted frame.

The scene and its camera are unchanged: a second scene has the first as its background set and renders it through its own camera.
"""

from __future__ import annotations

import bpy

MARK = "seeing_wind_overscan"
"""Custom property of the second scene, and of its camera."""
SIMPLE = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}


def set_overscan(scene: bpy.types.Scene, wider: float) -> bpy.types.Scene:
    """The scene that renders `scene` with a wider frame; `scene` itself if no overscan is needed.

    The render settings are copied now; set the composite up again after changing them.

    Args:
        wider: factor, 1 or more, from the clip's frame to the wider one in both directions. The number of pixels stays the same.
    """
    found = next((each for each in bpy.data.scenes if MARK in each and each.background_set == scene), None)
    if wider <= 1.0:
        if found is not None:
            _remove(found)
        return scene
    if found is None:
        found = bpy.data.scenes.new(f"{scene.name} Overscan")
        found[MARK], found.background_set = True, scene
    for source, target in ((scene.render, found.render), (scene.cycles, found.cycles), (scene.view_settings, found.view_settings)):
        _take_over(source, target)
    found.render.use_compositing, found.world = False, scene.world
    _remove_cameras(found)
    found.camera = _camera(scene.camera, wider)
    found.collection.objects.link(found.camera)
    return found


def _take_over(source: bpy.types.bpy_struct, target: bpy.types.bpy_struct) -> None:
    """Copy every simple setting that differs, except arrays."""
    for prop in source.bl_rna.properties:
        if prop.type not in SIMPLE or prop.is_readonly or getattr(prop, "is_array", False):
            continue
        value = getattr(source, prop.identifier)
        # "" is an enum whose stored number is no longer valid; it cannot be assigned
        if value != getattr(target, prop.identifier) and value != "":
            setattr(target, prop.identifier, value)


def _camera(camera: bpy.types.Object, wider: float) -> bpy.types.Object:
    """A camera that is parented to `camera` and sees more on every side."""
    data = camera.data.copy()
    data.name = f"{camera.data.name} Overscan"
    for background in list(data.background_images):
        data.background_images.remove(background)
    # the shift is measured in frame widths
    data.sensor_width, data.sensor_height = data.sensor_width * wider, data.sensor_height * wider
    data.ortho_scale, data.shift_x, data.shift_y = data.ortho_scale * wider, data.shift_x / wider, data.shift_y / wider
    obj = bpy.data.objects.new(data.name, data)
    obj[MARK], obj.parent = True, camera
    return obj


def _remove(scene: bpy.types.Scene) -> None:
    _remove_cameras(scene)
    bpy.data.scenes.remove(scene)


def _remove_cameras(scene: bpy.types.Scene) -> None:
    for obj in [each for each in scene.collection.objects if MARK in each]:
        data = obj.data
        bpy.data.objects.remove(obj)
        if data.users == 0:
            bpy.data.cameras.remove(data)
