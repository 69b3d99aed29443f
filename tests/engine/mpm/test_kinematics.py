"""Pins that follow a path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.errors import SimulationError, UsageError
from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.autograd import simulate
from seeing_wind.engine.mpm.lattice.beside import carried, velocity_at
from seeing_wind.engine.mpm.lattice.boundary import HELD
from seeing_wind.engine.mpm.lattice.colliders import Plane
from seeing_wind.engine.mpm.lattice.kinematics import conditions_for
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from tests.engine.mpm.bodies import block

POST = Material("post", "corotated", density=500.0, youngs_modulus=2e4, poisson_ratio=0.3)
FPS = 30.0


def post():
    return block((3, 3, 8), pinned_below=0.025)


def rotation(angle, axis=1):
    c, s = np.cos(angle), np.sin(angle)
    return {1: np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]), 2: np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])}[axis]


def driven(body, path, frames, *, v=None, spin=None, push=0.0, gravity=(0, 0, 0)):
    model, _ = model_for(body, POST, FPS, gravity=gravity, pin_path=path)
    acceleration = np.broadcast_to([push, 0.0, 0.0], (frames, model.particles, 3))
    return rollout(model, State.at_rest(body.x, v, spin), acceleration), model


def test_a_still_path_is_the_same_as_no_path():
    body = post()
    path = np.broadcast_to(body.x[body.pinned], (5, body.pinned.sum(), 3))
    moved, model = driven(body, path, 4, push=3.0)
    still, _ = driven(body, None, 4, push=3.0)
    assert not (model.role == HELD).any()
    assert np.allclose(moved.x[:, ~body.pinned], still.x[:, ~body.pinned], atol=1e-9)


def test_a_post_that_is_carried_along_bends_as_one_that_stands():
    # Galilean invariance: ten cells a second sideways and up, in a wind.
    body, velocity = post(), np.array([0.16, -0.05, 0.07])
    start = body.x[body.pinned]
    path = start + velocity * (np.arange(7) / FPS)[:, None, None]
    carried_along, _ = driven(body, path, 6, v=velocity, push=3.0)
    standing, _ = driven(body, None, 6, push=3.0)
    along = carried_along.x - velocity * (np.arange(7) / FPS)[:, None, None]
    bend = np.abs(standing.x - standing.x[0]).max()
    assert np.abs(along - standing.x)[:, ~body.pinned].max() < 0.05 * bend
    assert np.allclose(carried_along.x[:, body.pinned], path, atol=1e-12)


@pytest.mark.parametrize("axis", [1, 2])
def test_a_post_that_is_turned_turns_with_its_foot(axis):
    body, rate, frames = post(), 2.0, 8
    start = body.x[body.pinned]
    path = np.stack([start @ rotation(rate * t / FPS, axis).T for t in range(frames + 1)])
    spin = np.zeros(3)
    spin[axis] = rate
    x = body.x
    v = np.cross(spin, x)
    model, _ = model_for(body, POST, FPS, gravity=(0, 0, 0), pin_path=path)
    C = np.tile(rotation(np.pi / 2, axis) * rate, (len(x), 1, 1))
    C[:, axis, axis] = 0.0
    state = State(x, v, C, np.tile(np.eye(3), (len(x), 1, 1)))
    end = rollout(model, state, np.zeros((frames, len(x), 3)))
    turned = x @ rotation(rate * frames / FPS, axis).T
    assert np.allclose(end.x[:, body.pinned], path, atol=1e-12)
    # Centrifugal and inertial forces bend it a little.
    assert np.abs(end.x[-1] - turned).max() < 0.06 * np.abs(turned - x).max()


def test_clamped_nodes_move_as_the_pins_do():
    body = post()
    shift = np.array([0.02, 0.0, 0.01])
    path = np.stack([body.x[body.pinned] + t * shift for t in range(3)])
    model, _ = model_for(body, POST, FPS, pin_path=path)
    pieces = conditions_for(model, 1, State.at_rest(body.x))
    assert len(pieces) > 5
    for piece in pieces:
        assert piece.clamp.any() and np.allclose(piece.clamp_velocity[piece.clamp != 0], shift * FPS)
    middle = np.mean([piece.offset for piece in pieces], axis=0)
    assert np.allclose(middle, model.offset + 1.5 * shift)
    with_floor, _ = model_for(body, POST, FPS, pin_path=path, colliders=[Plane((0, 0, -0.1), (0, 0, 1))])
    assert conditions_for(with_floor, 0, State.at_rest(body.x))[0].planes[0, 4] > 0


def test_two_held_ends_may_move_against_each_other():
    body = block((10, 3, 3), jitter=0.0)
    left, right = body.x[:, 0] < 0.015, body.x[:, 0] > 0.075
    body = replace(body, pinned=left | right)
    pull = np.where(right[body.pinned], 1.0, -1.0)[:, None] * [0.001, 0.0, 0.0]
    path = np.stack([body.x[body.pinned] + t * pull for t in range(7)])
    end, model = driven(body, path, 6)
    stretch = (end.x[-1] - end.x[0])[~body.pinned, 0]
    position = body.x[~body.pinned, 0] - body.x[:, 0].mean()
    slope = (stretch * position).sum() / (position**2).sum()
    assert slope == pytest.approx(0.012 / 0.07, rel=0.3)  # 12 mm over the 7 cm between the borders
    assert np.abs(stretch[np.abs(position) < 0.006]).max() < 0.002


@pytest.mark.parametrize("count", [1, 2, 4, 30])
def test_places_beside_the_pins_follow_their_rigid_motion(count):
    rng = np.random.default_rng(0)
    flat = rng.normal(size=(count, 3)) * [1, 1, 0]  # all in one plane, or fewer
    places = rng.normal(size=(20, 3)) * 0.2
    R, shift = rotation(0.7), np.array([0.3, 0.1, -0.2])
    got = carried(places, flat, flat @ R.T + shift)
    assert np.isfinite(got).all()
    spin = np.array([0.1, -2.0, 0.4])
    v = velocity_at(places, flat, np.cross(spin, flat) + shift)
    assert np.isfinite(v).all()
    if count > 2:
        assert np.allclose(got, places @ R.T + shift, atol=1e-4)
        assert np.allclose(v, np.cross(spin, places) + shift, atol=1e-4)
    if count == 1:
        assert np.allclose(got, places + (flat @ R.T + shift - flat))


def test_gradients_along_a_path_match_finite_differences():
    body = block((3, 3, 4), pinned_below=0.015)
    step = np.array([0.004, 0.001, 0.002])
    path = np.stack([body.x[body.pinned] + t * step for t in range(3)])
    model, _ = model_for(body, POST, FPS, pin_path=path)
    model = replace(model, substeps=12, frame_dt=model.frame_dt / model.substeps * 12)
    rng = np.random.default_rng(0)
    inputs = [0.1 * rng.normal(size=body.x.shape), 3 * rng.normal(size=(2, *body.x.shape))]
    weight = rng.normal(size=(3, *body.x.shape))

    def loss(v, acceleration):
        return (weight * rollout(model, State.at_rest(body.x, v), acceleration).x).sum()

    tensors = [torch.tensor(array, requires_grad=True) for array in inputs]
    (torch.tensor(weight) * simulate(model, torch.tensor(body.x), *tensors)[0]).sum().backward()
    for which, h in enumerate((1e-6, 1e-3)):
        direction = rng.normal(size=inputs[which].shape)
        ends = [loss(*[a + s * h * direction if k == which else a for k, a in enumerate(inputs)]) for s in (1, -1)]
        assert (tensors[which].grad.numpy() * direction).sum() == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-6)


# -- what is refused --------------------------------------------------------------------------------------------------------------


def test_bad_paths_are_refused_with_advice():
    body = post()
    good = np.broadcast_to(body.x[body.pinned], (3, body.pinned.sum(), 3)).copy()
    holed, away = good.copy(), good + 0.01
    holed[1, 4, 2] = np.nan
    for path, match in ((good[:, 1:], "shape"), (good[0], "shape"), (good[:1], "shape"), (holed, "particle 4 is not finite in frame 1")):
        with pytest.raises(UsageError, match=match):
            model_for(body, POST, FPS, pin_path=path)
    with pytest.raises(UsageError, match="17.3 mm away"):
        model_for(body, POST, FPS, pin_path=away)
    with pytest.raises(UsageError, match="none is pinned"):
        model_for(block(), POST, FPS, pin_path=good)


def test_a_path_that_ends_too_early_names_the_frame():
    body = post()
    path = np.broadcast_to(body.x[body.pinned], (3, body.pinned.sum(), 3))
    model, _ = model_for(body, POST, FPS, pin_path=path)
    with pytest.raises(SimulationError, match="ends at frame 2, before frame 2") as caught:
        conditions_for(model, 2, State.at_rest(body.x))
    assert caught.value.frame == 2
