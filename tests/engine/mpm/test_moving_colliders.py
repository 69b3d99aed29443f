"""Solids that meet meshes that move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.mpm.lattice.colliders import Plane, within_reach
from seeing_wind.engine.mpm.lattice.mesh_collider import MeshCollider
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from tests.engine.mpm.bodies import RUBBER, SPACING, block

trimesh = pytest.importorskip("trimesh")

G, FPS = 9.81, 30.0
STIFF = replace(RUBBER, youngs_modulus=1e5)


def table(way, size=(0.5, 0.5, 0.1), top=0.0, **options) -> MeshCollider:
    """A slab below z = top that goes along `way` (T+1, 3) [m]."""
    shape = trimesh.creation.box(size)
    vertices = np.asarray(shape.vertices) + [0.05, 0.05, top - 0.5 * size[2]]
    return MeshCollider(vertices, np.asarray(shape.faces), path=vertices + np.asarray(way)[:, None], **options)


def slab(height=0.5 * SPACING):
    """A slab whose underside lies in z = 0."""
    body = block((6, 6, 3), jitter=0.0)
    return replace(body, x=body.x + [0.0, 0.0, height])


def run(body, colliders, frames, *, gravity=(0, 0, -G), v=None):
    model, _ = model_for(body, STIFF, FPS, gravity=gravity, colliders=colliders)
    return rollout(model, State.at_rest(body.x, v), np.zeros((frames, model.particles, 3))), model


def line(velocity, frames) -> np.ndarray:
    return np.arange(frames + 1)[:, None] / FPS * np.asarray(velocity, dtype=float)


def test_a_lift_carries_what_lies_on_it():
    """Up with 0.3 m/s: the underside stays on the floor of the lift, and moves as fast."""
    frames, body = 12, slab()
    path, model = run(body, [table(line((0, 0, 0.3), frames), friction=0.5)], frames, v=np.broadcast_to([0, 0, 0.3], body.x.shape))
    underside = path.x[:, body.x[:, 2] < SPACING, 2].mean(axis=1) - 0.5 * SPACING
    assert np.abs(underside - 0.3 * np.arange(frames + 1) / FPS)[3:].max() < 0.6 * model.dx
    assert path.v[4:, :, 2].mean() == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize("speed", [0.3, pytest.param(-0.3, marks=pytest.mark.slow)])
def test_what_lies_on_a_lift_sinks_no_deeper_than_on_a_floor(speed):
    frames, body, floor = 40, slab(), table(line((0, 0, 0), 40))
    stood, model = run(body, [MeshCollider(floor.vertices, floor.faces)], frames)
    way = line((0, 0, speed), frames)
    carried, _ = run(body, [table(way)], frames, v=np.broadcast_to([0, 0, speed], body.x.shape))
    deeper = (stood.x - carried.x + way[:, None])[:, body.x[:, 2] < SPACING, 2].mean(axis=1)
    assert np.abs(deeper[20:]).max() < 0.03 * model.dx


def test_a_hammer_drives_what_it_meets_before_it():
    """Without gravity, from the side: nothing gets into it, and what it has hit is at least as fast."""
    frames, body = 14, slab()
    wall = table(line((1.0, 0, 0), frames), size=(0.2, 0.4, 0.4), top=0.25)
    wall = replace(wall, path=wall.path - [0.25, 0, 0], vertices=wall.vertices - [0.25, 0, 0])
    path, model = run(body, [wall], frames, gravity=(0, 0, 0))
    face = wall.path[:, :, 0].max(axis=1)
    assert face[0] < body.x[:, 0].min() < face[-1]
    assert (path.x[..., 0].min(axis=1) - face).min() > -0.5 * model.dx
    assert path.v[-1, :, 0].mean() > 0.95


@pytest.mark.parametrize("friction", [0.2, pytest.param(0.4, marks=pytest.mark.slow)])
def test_a_table_that_is_drawn_away_takes_things_along_by_friction(friction):
    """With 1 m/s: what lies there gains mu g a second until it is as fast."""
    frames = 12
    path, _ = run(slab(), [table(line((1.0, 0, 0), frames), size=(1.5, 0.3, 0.1), friction=friction)], frames)
    expected = np.minimum(friction * G * np.arange(frames + 1) / FPS, 1.0)
    np.testing.assert_allclose(path.v[:, :, 0].mean(axis=1), expected, atol=0.08)


@pytest.mark.parametrize("friction", [0.4, *(pytest.param(one, marks=pytest.mark.slow) for one in (0.0, 1.0))])
def test_it_is_the_same_who_moves(friction):
    """A body that slides on a table that stands, and a table that is drawn away below one that stands."""
    frames, big = 8, (2.0, 0.4, 0.1)
    drawn, _ = run(slab(), [table(line((1.0, 0, 0), frames), size=big, friction=friction)], frames)
    body, still = slab(), table(line((0, 0, 0), frames), size=big, friction=friction)
    away = np.broadcast_to([-1.0, 0, 0], body.x.shape)
    slid, model = run(body, [MeshCollider(still.vertices, still.faces, friction=friction)], frames, v=away)
    np.testing.assert_allclose(drawn.x.mean(axis=1), slid.x.mean(axis=1) + line((1.0, 0, 0), frames), atol=0.1 * model.dx)


def test_a_turntable_turns_what_sticks_to_it():
    frames, omega = 10, 2.0
    still = table(np.zeros((frames + 1, 3)))
    angle = omega * np.arange(frames + 1) / FPS
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    turn = np.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1.0], axis=-1).reshape(-1, 3, 3)
    plate = MeshCollider(still.vertices, still.faces, kind="sticky", path=np.einsum("tij,vj->tvi", turn, still.vertices))
    body = slab()
    path, _ = run(body, [plate], frames)
    centre = path.x.mean(axis=1)
    np.testing.assert_allclose(centre[-1, :2], (turn[-1] @ centre[0])[:2], atol=0.1 * np.linalg.norm(centre[0, :2]))


def test_a_mesh_that_changes_its_shape_lifts_only_where_it_swells():
    """Of a slab's top, the edge at +x rises: what lies there is tilted and pushed to -x."""
    frames = 10
    still = table(np.zeros((frames + 1, 3)))
    rising = (still.vertices[:, 0] > 0.05) & (still.vertices[:, 2] > -0.05)
    path = np.repeat(still.vertices[None], frames + 1, axis=0)
    path[:, rising, 2] += 0.15 * np.arange(frames + 1)[:, None] / frames
    body = slab()
    moved, _ = run(body, [MeshCollider(still.vertices, still.faces, path=path)], frames)
    lifted, along = moved.x[-1, :, 2] - body.x[:, 2], body.x[:, 0]
    assert np.polyfit(along, lifted, 1)[0] > 0.1 and moved.v[-1, :, 0].mean() < -0.05


def test_after_its_path_a_collider_stands_still():
    short = table(line((0, 0, 1.0), 2))
    after = short.posed(3.5, 1.0 / FPS)
    np.testing.assert_allclose(after.vertices, short.path[-1])
    assert after.velocity is not None and not after.velocity.any()
    late = short.delayed(4)
    np.testing.assert_allclose(late.posed(5.5, 1.0 / FPS).vertices, short.posed(1.5, 1.0 / FPS).vertices)


def test_only_what_is_near_is_sampled():
    far = table(line((0, 0, 1.0), 4) + [40.0, 0.0, 0.0])
    near, floor = table(line((0, 0, 1.0), 4)), Plane((0, 0, 0), (0, 0, 1))
    region = np.array([[-0.2] * 3, [0.2] * 3])
    assert within_reach([far, near, floor], region, 1) == (near, floor)
    assert within_reach([far, floor], region, 1) == ()


@pytest.mark.parametrize(("path", "says"), [
    (np.zeros((1, 8, 3)), "shape"), (np.zeros((4, 7, 3)), "shape"), (np.full((4, 8, 3), np.nan), "not finite, or leads too far"),
    (np.full((4, 8, 3), 1e9), "far"),
])  # fmt: skip
def test_paths_that_lead_nowhere_are_refused(path, says):
    still = table(np.zeros((2, 3)))
    with pytest.raises(UsageError, match=says):
        MeshCollider(still.vertices, still.faces, path=path)
