"""A scene of another frame rate than the clip's: field, object, bakes and solvers in step with the clock."""

from __future__ import annotations

import tomllib
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.ui.field.conform import set_stride
from seeing_wind.ui.field.display import out_of_time, said_of_mirror, said_of_override, said_of_speed
from seeing_wind.ui.field.field_object import create_field_object
from seeing_wind.ui.field.lattice import SampledField, fine_lattice
from seeing_wind.ui.field.samples import samples_of
from seeing_wind.ui.field.solvers.calibration import calibrate_object
from tests.ui.jobs import recover
from tests.ui.meshes import cube

FPS, FRAMES, START, DENSITY = 24.0, 12, 5, 10.0


def numbered(scene: bpy.types.Scene, force: float = 0.0) -> bpy.types.Object:
    """A field whose force along Z is the number of the frame, or the same in all."""
    nodes = fine_lattice(np.array([[-2.0, -2.0, -2.0], [2.0, 2.0, 2.0]]))
    values = np.zeros((FRAMES, len(nodes), 3))
    values[..., 2] = force or np.arange(FRAMES)[:, None]
    sampled = SampledField(nodes, values, np.ones(values.shape[:2]))
    return create_field_object(scene, "Wind", sampled, fps=FPS, density=DENSITY, frame_start=START, reach="HOLD")


def felt(field: bpy.types.Object, scene: bpy.types.Scene, frame: float) -> float:
    scene.frame_set(int(frame), subframe=frame % 1.0)
    carried = samples_of(field)
    carried.hide_viewport = False
    mesh = carried.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    return mesh.attributes["force"].data[0].vector[2]


@pytest.mark.parametrize("fps", [24, 25, 30, 60, 12])
def test_solvers_step_to_a_frame_with_the_force_of_the_middle_of_that_step(scene, fps) -> None:
    field = numbered(scene)
    set_stride(field, fps / FPS)
    for frame in range(START + 1, START + 1 + int(FRAMES * fps / FPS)):
        middle = (frame - 0.5 - START) / fps * FPS
        assert felt(field, scene, frame) == pytest.approx(np.floor(middle + 1e-4), abs=1e-4), frame


def test_between_frames_the_force_of_that_interval_acts(scene) -> None:
    field = numbered(scene)
    for frame, clip_frame in ((START + 1.0, 0), (START + 1.25, 1), (START + 2.0, 1), (START + 2.75, 2)):
        assert felt(field, scene, frame) == pytest.approx(clip_frame, abs=1e-4)


@pytest.mark.parametrize("fps", [24, 48, 30])
def test_particles_fly_as_far_in_a_second_at_any_frame_rate(scene, stand_in, fps) -> None:
    field = numbered(scene, force=20.0)
    scene.render.fps, scene.use_gravity, scene.frame_end = fps, False, 200
    bpy.ops.mesh.primitive_plane_add(size=0.02)
    obj = bpy.context.object
    settings = obj.modifiers.new("Dust", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.frame_start, settings.frame_end, settings.lifetime, settings.normal_factor = 5, START, START, 500, 0.0
    calibrate_object(scene, obj, field, density=DENSITY)
    entry = scene.seeing_wind.calibrations.add()
    entry.object, entry.field, entry.density, entry.fps = obj, field, DENSITY, fps
    assert bpy.ops.seeing_wind.conform(field="Wind") == {"FINISHED"}
    assert not out_of_time(scene) and said_of_speed(field, scene) == ""
    half = fps // 2
    for frame in range(1, START + half + 1):
        scene.frame_set(frame)
    system = obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).particle_systems[0]
    assert np.mean([particle.location[2] for particle in system.particles]) == pytest.approx(0.5 * 2.0 * 0.25, rel=0.07)


def test_a_field_that_a_parent_mirrors_is_told(scene) -> None:
    field = numbered(scene)
    assert said_of_mirror(field) == ""
    parent = bpy.data.objects.new("Mirror", None)
    scene.collection.objects.link(parent)
    field.parent, parent.scale = parent, (-1.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    assert said_of_mirror(field).startswith("Mirrored by a negative scale: solvers feel this wind against its arrows")
    bpy.ops.mesh.primitive_plane_add()
    obj = bpy.context.object
    obj.modifiers.new("Dust", "PARTICLE_SYSTEM")
    assert said_of_mirror(field) in calibrate_object(scene, obj, field)
    parent.scale.x = 1.0
    bpy.context.view_layer.update()
    assert not [line for line in calibrate_object(scene, obj, field) if "Mirrored" in line]


@pytest.mark.parametrize(("scale", "told"), [((-1.0, 1.0, 1.0), True), ((1.0, 1.0, -1.0), True), ((-1.0, -1.0, 1.0), False)])
def test_what_is_told_of_a_mirror_is_what_solvers_feel(scene, checks, scale, told) -> None:
    """The opposite of what the field and its arrows show; two mirrors are a turn."""
    field = checks["swirl_field"](scene)
    field.scale = scale
    bpy.context.view_layer.update()
    angle, size = checks["field_errors"](scene, field, 2, count=40)
    assert bool(said_of_mirror(field)) == told and size < 0.02
    assert angle > 179.0 if told else angle < 1.0


def test_everything_of_a_take_keeps_the_clock(scene, stand_in, workplace, capfd) -> None:
    recover(workplace)
    settings = scene.seeing_wind
    box = cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    bpy.ops.seeing_wind.bake(way="SHAPE_KEYS")

    def shown(obj: bpy.types.Object, seconds: float) -> np.ndarray:
        frame = settings.frame_start + seconds * scene.render.fps / scene.render.fps_base
        scene.frame_set(int(frame), subframe=frame % 1.0)
        evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        return np.mean([(evaluated.matrix_world @ vertex.co)[:] for vertex in evaluated.data.vertices], axis=0)

    times = np.array([0.0, 0.1, 0.2, 0.33, 0.5])
    before = [[shown(obj, t) for t in times] for obj in (settings.recovered_object, box)]
    scene.render.fps = 30
    assert said_of_speed(settings.field_object, scene).startswith("Plays at 1.25 times")
    assert bpy.ops.seeing_wind.conform() == {"FINISHED"}
    assert np.allclose([[shown(obj, t) for t in times] for obj in (settings.recovered_object, box)], before, atol=1e-4)
    assert scene.frame_end == settings.frame_start + 15
    # what is loaded and made again later keeps it
    bpy.ops.seeing_wind.build_scene()
    bpy.ops.seeing_wind.apply_to_field()
    assert settings.field_object["seeing_wind_stride"] == 1.25
    assert np.allclose([shown(settings.recovered_object, t) for t in times], before[0], atol=1e-4)
    # keyframes of the strength are read at the time of each frame
    for frame, value in ((settings.frame_start, 0.0), (settings.frame_start + 15, 1.0)):
        settings.field_strength = value
        settings.keyframe_insert("field_strength", frame=frame)
    for curve in scene.animation_data.action.layers[0].strips[0].channelbags[0].fcurves:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    bpy.ops.seeing_wind.resimulate()
    strength = tomllib.loads((Path(settings.simulated_take) / "edit.toml").read_text())["field_strength"]
    assert strength == pytest.approx([t / 12 for t in range(12)], abs=1e-4)
    scene.render.fps = 24
    capfd.readouterr()
    assert bpy.ops.seeing_wind.conform(real_time=False) == {"FINISHED"}
    assert "a clip frame lasts 1 scene frame\n" in capfd.readouterr().out.replace(";", "\n")
    assert np.allclose([shown(settings.recovered_object, t) for t in times], before[0], atol=1e-4) and scene.frame_end == 13


def test_a_turned_library_override_is_told(scene, tmp_path) -> None:
    numbered(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "wind.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "wind.blend"), link=True) as (_, wanted):
        wanted.objects = ["Wind"]
    bpy.context.scene.collection.objects.link(wanted.objects[0])
    field = wanted.objects[0].override_create(remap_local_usages=True)
    field.location.x = 3.0
    bpy.context.view_layer.update()
    assert said_of_override(field) == "" == said_of_override(field.override_library.reference)
    field.rotation_euler.z = 0.5
    bpy.context.view_layer.update()
    assert "in the old directions" in said_of_override(field)
