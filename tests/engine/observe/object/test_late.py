"""Tracks that begin after frame 0, tied to the body's moved surface."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.observe.object.motion.keypoints import place
from seeing_wind.engine.observe.object.motion.late import tie
from seeing_wind.engine.observe.object.motion.pose import BodyPose
from seeing_wind.engine.observe.object.shape.particles import fill
from seeing_wind.engine.observe.object.shape.relief import relief_of
from seeing_wind.engine.observe.object.shape.surface import surface_of
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Camera, Observation
from seeing_wind.engine.settings import BuildSettings
from seeing_wind.engine.stages import build_body

STEP = np.array([3.0, 0.0])
"""Pixels that the plate slides in a frame."""


def sliding(plate: Observation, late: list[list[float]]) -> Observation:
    """The sliding plate, with tracks that begin at the pixels `late` of frame 1 and move with it."""
    early = plate.xy + np.arange(3)[:, None, None] * STEP
    later = np.array(late)[None] + (np.arange(3)[:, None, None] - 1.0) * STEP
    xy = np.concatenate([early, later], axis=1)
    visible = np.ones(xy.shape[:2], bool)
    visible[0, early.shape[1] :] = False
    masks = np.stack([np.roll(np.asarray(plate.masks[0]), 3 * t, axis=1) for t in range(3)])
    count = xy.shape[1]
    return dataclasses.replace(
        plate,
        masks=masks,
        xy=np.where(visible[..., None], xy, np.nan),
        visible=visible,
        sigma=np.full(visible.shape, 0.2),
        on_centroid=np.zeros(count, bool),
    )


def tied(seen: Observation) -> tuple[np.ndarray, np.ndarray]:
    """`tie` of all later tracks."""
    relief = relief_of(seen)
    particles = fill(relief, 150)
    points = place(seen, relief, particles)
    return tie(seen, surface_of(relief, particles.x), points, seen.visible.argmax(axis=0), NoProgress())


def test_a_later_track_is_tied_to_where_its_rays_meet_the_body(plate: Observation) -> None:
    seen = sliding(plate, [[50.0, 32.0], [60.0, 28.0]])
    ties, spread = tied(seen)
    where = plate.camera.project(ties[-2:])[0]
    assert where == pytest.approx(np.array([[47.0, 32.0], [57.0, 28.0]]), abs=1.0)
    assert np.isnan(ties[:-2]).all() and (spread[-2:] < 1.0).all()


def test_later_tracks_that_meet_the_body_nowhere_have_no_place(plate: Observation) -> None:
    seen = sliding(plate, [[10.0, 60.0], [85.0, 8.0]])
    ties, _ = tied(seen)
    assert np.isnan(ties).all()


def test_a_body_is_built_without_the_tracks_that_meet_it_nowhere(plate: Observation) -> None:
    seen = sliding(plate, [[10.0, 60.0], [85.0, 8.0]])
    body = build_body(seen, BuildSettings(particles=150), NoProgress())
    assert np.isfinite(body.lifted[:, :-2]).all() and np.isfinite(body.particles.x).all()
    assert not np.isfinite(body.lifted[1:, -2:]).all(axis=-1).any(), "they pull at nothing"


def test_what_is_held_stays_in_its_place_while_the_rest_is_dragged_along() -> None:
    rows, columns = np.mgrid[:41, :5]
    rest = np.stack([0.01 * (columns - 2.0), np.zeros_like(rows, float), 0.01 * rows], axis=-1).reshape(-1, 3)
    camera = Camera(200, 200, 200.0, 200.0, 99.5, 99.5, front_view(1.0))
    held, top = rest[:, 2] < 0.05, rest[:, 2] > 0.3
    feet = []
    for still in (held, np.zeros_like(held)):
        body = BodyPose(rest, camera, rest[top], still)
        for t in range(1, 6):
            xy = camera.project(rest[top])[0] + [4.0 * t, 0.0]
            body.advance(t, body.weights(rest[top]), xy, np.full(int(top.sum()), 0.2), np.zeros((200, 200), bool))
        feet.append(np.abs(camera.project(body.vertices[held])[0] - camera.project(rest[held])[0]).max())
        assert np.abs(camera.project(body.vertices[top])[0] - xy).max() < 4.0
    assert feet[0] < 1.0 < 5.0 < feet[1]
