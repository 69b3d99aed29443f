"""Pinned vertices hold, and parts that were held in the clip can be released."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from seeing_wind.engine.conventions import GRAVITY
from seeing_wind.engine.materials import Material
from seeing_wind.engine.records import Attachment, Body, Gaussians, Outcome, Particles, Recovery, Surface
from seeing_wind.engine.settings import BodyEdit
from tests.engine.recovery.resimulate.edits import FPS, FRAMES, SOFT, run, uniform, waves


def test_pinned_vertices_stay(folder):
    vertices = np.load(folder / "flag.npz")["vertices"]
    pins = np.flatnonzero(vertices[:, 0] < 1e-6)
    np.save(folder / "pins.npy", pins)
    flags = BodyEdit("held", "flag.npz", pin="pins.npy", **SOFT), BodyEdit("free", "flag.npz", **SOFT)
    bodies = run(folder, *flags, field=waves(12), gravity=(0, 0, -9.81))
    moved = np.linalg.norm(bodies["held"].vertices - vertices, axis=-1)
    assert moved[:, pins].max() < 1e-4
    assert moved[-1].max() > 0.02
    free = np.linalg.norm(bodies["free"].vertices - vertices, axis=-1)
    assert free[-1].min() > 0.5


def test_a_single_pinned_vertex_holds(folder):
    vertices = np.load(folder / "flag.npz")["vertices"]
    np.save(folder / "corner.npy", np.array([0]))
    body = run(folder, BodyEdit("held", "flag.npz", pin="corner.npy", **SOFT), gravity=(0, 0, -9.81))["held"]
    assert np.linalg.norm(body.vertices[:, 0] - vertices[0], axis=-1).max() < 1e-4
    assert np.isfinite(body.vertices).all()


def test_a_soft_pin_draws_back_like_a_spring(folder):
    """All of a box held with weight w under gravity g: it comes to rest g / omega² lower, omega² = 24² w / (1 - w)."""
    np.save(folder / "all.npy", np.arange(8))
    drop = {}
    for weight in (0.5, 0.9):
        np.save(folder / "weights.npy", np.full(8, weight))
        held = BodyEdit("box", "box.obj", pin="all.npy", pin_weights="weights.npy", **SOFT)
        path = run(folder, held, gravity=(0, 0, -9.81), field=uniform((0, 0, 0), 30))["box"].vertices
        drop[weight] = (path[0] - path[-12:])[..., 2].mean()  # its corners swing a little, for it is soft
        assert drop[weight] == pytest.approx(9.81 * (1.0 - weight) / weight / 24.0**2, rel=0.05)
    assert drop[0.5] == pytest.approx(9.0 * drop[0.9], rel=0.1)


def test_pins_that_move_take_the_body_along(folder):
    vertices = np.load(folder / "flag.npz")["vertices"]
    pins = np.flatnonzero(vertices[:, 0] < 1e-6)
    away = np.linspace(0.0, 0.3, FRAMES + 1)[:, None, None] * [0.0, 1.0, 0.0]
    np.save(folder / "pins.npy", pins)
    np.save(folder / "way.npy", vertices[pins] + away)
    body = run(folder, BodyEdit("held", "flag.npz", pin="pins.npy", pin_path="way.npy", **SOFT), field=uniform((0, 0, 0), FRAMES))["held"]
    np.testing.assert_allclose(body.vertices[:, pins], vertices[pins] + away, atol=1e-4)
    assert (body.vertices[-1] - vertices)[:, 1].mean() > 0.1


def test_weights_of_one_are_firm_pins(folder):
    np.save(folder / "corner.npy", np.array([3, 0]))
    np.save(folder / "weights.npy", np.array([1.0, 1.0]))
    firm = run(folder, BodyEdit("held", "flag.npz", pin="corner.npy", **SOFT))["held"].vertices
    weighted = run(folder, BodyEdit("held", "flag.npz", pin="corner.npy", pin_weights="weights.npy", **SOFT))["held"].vertices
    np.testing.assert_array_equal(weighted, firm)


def recovered_object() -> tuple[Body, Recovery]:
    axis = (np.arange(8) + 0.5) * 0.02
    x = np.stack(np.meshgrid(axis, [0.0, 0.02], axis, indexing="ij"), -1).reshape(-1, 3)
    count = len(x)
    each = Attachment(np.arange(count, dtype=np.int32)[:, None], np.ones((count, 1)))
    particles = Particles(x, np.full(count, 8e-6), np.zeros(count, dtype=bool), 0.02)
    cloud = Gaussians(x, np.full((count, 3), 0.01), np.tile([1.0, 0, 0, 0], (count, 1)), np.ones(count), np.zeros((count, 1, 3)), each)
    surface = Surface(x[:3], np.array([[0, 1, 2]], dtype=np.int32), np.zeros((3, 2)), Attachment(each.index[:3], each.weight[:3]))
    body = Body(particles, Material("clip", "corotated", 500.0, 2e4, 0.3), cloud, surface, each, np.zeros((FRAMES + 1, count, 3)))
    v0 = np.tile([0.0, 0.3, 0.0], (count, 1))
    zero = np.zeros((FRAMES, count, 3))
    path = np.tile(x, (FRAMES + 1, 1, 1))
    F = np.tile(np.eye(3), (FRAMES + 1, count, 1, 1))
    return body, Recovery(Outcome.CONVERGED, zero, zero[..., 0], path, F, v0, np.zeros(FRAMES + 1), "m", 1, 0.0)


def test_the_recovered_object_starts_with_its_own_velocity_and_takes_particle_pins(folder):
    source = recovered_object()
    free = run(folder, BodyEdit("clip", "recovered"), field=uniform((0, 0, 0)), recovered=source)["clip"].vertices
    np.testing.assert_allclose(free[-1] - free[0], np.tile([0, 0.3 * FRAMES / FPS, 0], (3, 1)), atol=1e-4)
    np.save(folder / "particles.npy", np.arange(32))
    held = run(folder, BodyEdit("clip", "recovered", pin="particles.npy"), recovered=source)["clip"].vertices
    assert np.linalg.norm(held - held[0], axis=-1).max() < 1e-4


def test_what_the_clip_held_can_be_let_go(folder):
    body, recovery = recovered_object()
    held = dataclasses.replace(body, particles=dataclasses.replace(body.particles, pinned=np.ones(len(body.particles.x), dtype=bool)))
    np.save(folder / "free.npy", np.arange(len(body.particles.x)))
    still = run(folder, BodyEdit("clip", "recovered"), recovered=(held, recovery))["clip"].vertices
    assert np.abs(still[-1] - still[0]).max() < 1e-6
    loose = run(folder, BodyEdit("clip", "recovered", free="free.npy"), recovered=(held, recovery))["clip"].vertices
    never_held = run(folder, BodyEdit("clip", "recovered"), recovered=(body, recovery))["clip"].vertices
    np.testing.assert_allclose(loose, never_held, atol=1e-12)


def test_a_held_object_bears_the_weight_that_it_had_in_the_clip_and_no_more(folder):
    body, recovery = recovered_object()
    x = body.particles.x
    tip = dataclasses.replace(body.surface, vertices=x[-3:], attachment=Attachment(body.keypoints.index[-3:], np.ones((3, 1))))
    held = dataclasses.replace(body, surface=tip, particles=dataclasses.replace(body.particles, pinned=x[:, 0] < 0.035))
    calm = dataclasses.replace(recovery, v0=np.zeros_like(recovery.v0))

    def sag(borne, **edit):
        source = held, dataclasses.replace(calm, borne=borne)
        found = run(folder, BodyEdit("clip", "recovered", **edit), field=uniform((0, 0, 0)), gravity=GRAVITY, recovered=source)
        height = found["clip"].vertices[:, :, 2]
        return height[1] - height[0]

    weight = np.array(GRAVITY)
    assert np.abs(sag(weight)).max() < 1e-9
    assert sag(None).max() < -1e-3
    # Of twice the mass half of the weight is borne: it begins to sag half as fast as one without a load.
    np.testing.assert_allclose(sag(weight, mass_scale=2.0), 0.5 * sag(None), rtol=0.1)


def test_what_the_clip_s_clamp_carried_along_is_carried_along_again(folder):
    body, recovery = recovered_object()
    foot = body.particles.x[:, 2] < 0.055
    held = dataclasses.replace(body, particles=dataclasses.replace(body.particles, pinned=foot))
    way = 0.02 * (1.0 - np.cos(np.pi * np.arange(FRAMES + 1) / FRAMES))
    path = recovery.x + way[:, None, None] * np.array([0.0, 1.0, 0.0])
    moving = dataclasses.replace(recovery, x=path, v0=np.zeros_like(recovery.v0), clamp_moves=True)
    follow = {"field": uniform((0, 0, 0)), "recovered": (held, moving)}
    vertices = run(folder, BodyEdit("clip", "recovered"), **follow)["clip"].vertices  # three on the foot
    np.testing.assert_allclose(vertices[:, :, 1] - vertices[0, :, 1], np.repeat(way[:, None], 3, axis=1), atol=1e-6)
    later = run(folder, BodyEdit("clip", "recovered", start_frame=2), **follow)["clip"].vertices
    assert np.abs(later - later[0]).max() < 1e-6
