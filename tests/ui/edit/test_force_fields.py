"""Blender's own force fields on their way to the engine, against what Blender's own solvers feel of them."""

from __future__ import annotations

import runpy
from pathlib import Path

import bpy
import numpy as np
import pytest

from seeing_wind.ui import freshness
from seeing_wind.ui.bake.animation import curves_of
from seeing_wind.ui.edit.resimulate.force_fields import force_fields
from tests.ui.edit.edits import state, written
from tests.ui.jobs import notes_of
from tests.ui.meshes import cube

CHECK = runpy.run_path(str(Path(__file__).resolve().parents[2] / "blender" / "force_fields_check.py"), run_name="checks")
push, at, felt_by_particles = (CHECK[name] for name in ("push", "at", "felt_by_particles"))
FRAMES = 12


def exported(workplace) -> dict[str, np.ndarray]:
    """What the engine reads: `box`, `force` and the rest."""
    assert written(workplace)["forces"] == "forces.npz"
    with np.load(workplace / "out.edit.take" / "forces.npz", allow_pickle=False) as data:
        return dict(data)


@pytest.mark.parametrize(
    ("kind", "unit"),
    [(kind, 1.0) for kind in CHECK["KINDS"]]
    + [pytest.param(kind, 0.1, marks=pytest.mark.slow if kind == "TURBULENCE" else ()) for kind in CHECK["KINDS"]],
)
def test_a_body_is_pushed_as_a_particle_of_blender_of_its_mass(workplace, recovered, kind, unit):
    """The engine divides by the body's whole mass: so the file has newtons, and Blender's particle of that mass the acceleration."""
    recovered.unit_settings.scale_length = unit
    bpy.ops.seeing_wind.build_scene()
    cube("Box").scale *= 1.0 / unit
    settings = {name: value / unit if name in ("size", "rest_length") else value for name, value in CHECK["KINDS"][kind].items()}
    push(kind, (3.0 / unit, 0.4, -0.2), **settings)
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    ratio, error = CHECK["compared"](exported(workplace), unit)
    assert abs(ratio - 1.0) < 0.01 and error < 0.02


def test_strengths_follow_their_keyframes_as_solvers_feel_them(workplace, recovered):
    cube("Box")
    wind = push("WIND", (0.0, 0.0, -1.0))
    for frame, strength in ((1, 0.0), (13, 24.0)):
        wind.field.strength = strength
        wind.keyframe_insert("field.strength", frame=frame)
    for curve in curves_of(wind):
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    middle = np.zeros((1, 3))
    found, truth = at(exported(workplace), middle)[:, 0], felt_by_particles(middle, 1.0, range(2, 2 + FRAMES))[:, 0]
    np.testing.assert_allclose(found, truth, atol=1e-4)
    assert np.ptp(found[:, 2]) == pytest.approx(22.0, abs=0.01)
    for frame in (1, 6, 13):
        recovered.frame_set(frame)
        freshness.refresh(recovered)
        assert state("resimulate") == "done", "scrubbing through keyframes changes nothing"
    wind.keyframe_insert("field.strength", frame=7)
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"


def test_what_depends_on_speed_is_there_as_well(workplace, recovered):
    cube("Box")
    push("DRAG", linear_drag=0.5, quadratic_drag=0.3)
    push("MAGNET", (2.0, 0.0, 0.0), strength=3.0)
    push("WIND", strength=2.0, flow=0.7)
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    found = exported(workplace)
    middle = {name: tuple(count // 2 for count in found[name].shape[1:4]) for name in ("force", "linear", "quadratic")}
    axes = found["box"].mean(axis=0)
    for v in ((0.0, 0.0, 0.0), (1.5, -0.5, 0.25)):
        truth = felt_by_particles(np.array([axes]), 1.0, range(5, 6), v)[0, 0]
        speed = np.linalg.norm(v)
        force, linear, quadratic = (found[name][3][node] for name, node in middle.items())
        np.testing.assert_allclose(force + linear @ v - quadratic * speed * np.array(v), truth, atol=1e-3)


def test_only_what_would_act_on_solvers_acts(workplace, recovered):
    cube("Box")
    inside, outside, disabled = push("WIND"), push("VORTEX"), push("TURBULENCE")
    disabled.hide_viewport = True
    chosen = bpy.data.collections.new("Effectors")
    recovered.collection.children.link(chosen)
    chosen.objects.link(inside)
    assert force_fields(recovered) == sorted([inside, outside], key=lambda obj: obj.name), "the recovered field is none of them"
    recovered.seeing_wind.effectors = chosen
    assert force_fields(recovered) == [inside]
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    scenes, objects, particles = len(bpy.data.scenes), len(bpy.data.objects), len(bpy.data.particles)
    bpy.ops.seeing_wind.resimulate()
    assert np.abs(exported(workplace)["force"][..., :2]).max() < 1e-6, "the wind alone, which blows upwards"
    assert (scenes, objects, particles) == (len(bpy.data.scenes), len(bpy.data.objects), len(bpy.data.particles))
    inside.field.strength = 3.0
    freshness.refresh(recovered)
    assert state("resimulate") == "stale"
    recovered.seeing_wind.use_force_fields = False
    bpy.ops.seeing_wind.resimulate()
    assert "forces" not in written(workplace)


def test_a_force_that_the_lattice_cannot_follow_is_told(workplace, recovered, capfd):
    cube("Box")
    push("TURBULENCE", strength=4.0, size=0.04)
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    said = capfd.readouterr().out
    assert "Turbulence acted" in said and "faster from place to place" in said


def test_a_mirrored_field_is_said_to_be_felt_otherwise(workplace, recovered):
    parent = bpy.data.objects.new("Mirror", None)
    recovered.collection.objects.link(parent)
    recovered.seeing_wind.field_object.parent, parent.scale = parent, (-1.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    assert [note for note in notes_of(recovered, "resimulate") if "Mirrored by a negative scale" in note]


def test_what_is_left_out_is_said(workplace, recovered, capfd):
    """Particles that push, and an obstacle that absorbs; nothing is said of what does neither."""
    cube("Box")
    bpy.ops.seeing_wind.insert_mesh(object="Box")
    bpy.ops.seeing_wind.resimulate()
    assert "left out" not in capfd.readouterr().out
    cube("Swarm", (0.0, 0.0, 2.0)).modifiers.new("Swarm", "PARTICLE_SYSTEM")
    bpy.data.objects["Swarm"].particle_systems[0].settings.force_field_1.type = "FORCE"
    wall = cube("Wall", (0.0, 0.0, -2.0))
    wall.modifiers.new("Collision", "COLLISION")
    wall.collision.absorption = 0.5
    push("WIND", (0.0, 0.0, -1.0))
    recovered.seeing_wind.bodies[0].mass_scale = 2.0
    bpy.ops.seeing_wind.resimulate()
    said = capfd.readouterr().out
    assert "The particles of Swarm push with a force field of their own: it is left out" in said
    assert "Wall should absorb force fields" in said
