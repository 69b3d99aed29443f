"""Finer Gaussians: only where a frame shows them wide, on the surface that the motion carries, and sharper for it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from seeing_wind.engine.look.covering import joined
from seeing_wind.engine.look.finer import SHRUNK, finer
from seeing_wind.engine.look.over_clip import fit_appearance
from seeing_wind.engine.observe.object.motion.control import attach
from seeing_wind.engine.records import Gaussians

from .test_appearance import CAMERA, WALL, drawn, filmed, footage, front_only, lattice, motion, off
from .test_gaussians_ply import self_attached


def test_halves_lie_where_the_whole_was_too_wide() -> None:
    whole, found = front_only().gaussians, motion(np.zeros(2))
    frames = [(0, found.x[0], found.F[0])]
    assert finer(whole, lattice(), CAMERA, frames).x == pytest.approx(whole.x), "half a pixel wide: fine enough"
    wide = dataclasses.replace(whole, scale=whole.scale * [3.0, 1.0, 1.0])
    halves = finer(wide, lattice(), CAMERA, frames)
    assert len(halves.x) == 2 * len(wide.x) and halves.scale == pytest.approx(np.tile(wide.scale * [SHRUNK, 1.0, 1.0], (2, 1)))
    assert (halves.x[: len(wide.x)] + halves.x[len(wide.x) :]) / 2 == pytest.approx(wide.x), "on either side"
    assert halves.attachment.follow(lattice()) == pytest.approx(halves.x, abs=1e-9)
    both = finer(dataclasses.replace(whole, scale=whole.scale * [3.0, 4.0, 1.0]), lattice(), CAMERA, frames)
    assert len(both.x) == 4 * len(whole.x) and both.x[:, 1] == pytest.approx(np.full(len(both.x), whole.x[0, 1])), "in the surface"
    grown = [*frames, (1, found.x[1], 3.0 * found.F[1])]
    assert len(finer(whole, lattice(), CAMERA, grown).x) == 4 * len(whole.x), "another frame shows them wide"


def test_sets_that_more_and_fewer_particles_carry_are_joined() -> None:
    one = front_only().gaussians
    alone = dataclasses.replace(one, attachment=self_attached(len(one.x)))
    for pair in ((one, alone), (alone, one)):
        follow = joined(*pair).attachment.follow(np.concatenate([lattice(), np.zeros((len(one.x) - 27, 3))]))
        assert len(follow) == 2 * len(one.x)
    assert joined(alone, one).attachment.follow(one.x)[: len(one.x)] == pytest.approx(one.x)


def test_coarse_gaussians_come_to_show_fine_texture() -> None:
    body, found = front_only(), motion(np.zeros(2))
    frames, masks = filmed(found, np.ones(2))
    stripes = np.where(np.arange(CAMERA.width) // 3 % 2 == 0, 60, 180).astype(np.uint8)
    frames = np.where(masks[..., None], stripes[None, None, :, None], np.full_like(frames, WALL))
    third = (_ranks(body.gaussians.x[:, [0, 2]]) % 3 == 1).all(axis=1)
    every = {name: getattr(body.gaussians, name)[third] for name in ("x", "rotation", "opacity", "sh")}
    coarse = Gaussians(**every, scale=3.0 * body.gaussians.scale[third], attachment=attach(every["x"], lattice()))
    fitted = fit_appearance(dataclasses.replace(body, gaussians=coarse), found, footage(frames, masks))
    error = off(frames[1], drawn(body, fitted, found, 1), masks[1])
    assert error < 25.0, "without halves it is 31; a frame without stripes is off by 60"


def _ranks(points: np.ndarray) -> np.ndarray:
    """Row and column numbers of points on a lattice."""
    return np.stack([np.unique(values.round(9), return_inverse=True)[1] for values in points.T], axis=1)
