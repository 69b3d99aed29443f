"""Front, back and the particles between."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from seeing_wind.engine.errors import ObjectError
from seeing_wind.engine.observe.object.shape.particles import fill, spread
from seeing_wind.engine.observe.object.shape.relief import relief_of
from seeing_wind.engine.progress import Cancelled, Progress
from tests.engine.observations import FOCAL, camera, observed


def test_unprojection_goes_back_to_the_pixels(plate) -> None:
    relief = relief_of(plate)
    rows, columns = np.nonzero(relief.mask)
    xy = np.stack([columns, rows], axis=1).astype(float)
    for across in (0.0, 0.5, 1.0):
        back, depth = plate.camera.project(relief.points(xy, across))
        assert np.abs(back - xy).max() < 1e-9
        assert (depth > 0).all()
    assert plate.camera.project(relief.points(xy, 0.0))[1] == pytest.approx(plate.depth[relief.mask], rel=1e-5)


def test_kinds_of_bodies(plate, ball) -> None:
    assert relief_of(plate).kind == "plate"
    assert relief_of(ball).kind == "ball"
    long = np.zeros_like(plate.masks[0])
    long[10:60, 40:46] = True
    assert relief_of(observed(long, 1.0)).kind == "post"
    # A measured front of a ball is solid; a measured flat disc is none.
    rows, columns = np.mgrid[:72, :96]
    disc = (rows - 36) ** 2 + (columns - 48) ** 2 <= 400
    bulge = 1.0 - np.sqrt(np.maximum(400 - (rows - 36.0) ** 2 - (columns - 48.0) ** 2, 0.0)) / FOCAL
    tilt = 1.0 + 0.002 * (columns - 48)
    assert relief_of(observed(disc, bulge)).kind == "ball"
    assert relief_of(observed(disc, tilt)).kind == "plate"


def test_a_post_of_unknown_depth_is_round() -> None:
    long = np.zeros((72, 96), bool)
    long[10:60, 38:48] = True
    seen = observed(long, 1.0)
    post, breadth = relief_of(seen), 10.0 / FOCAL
    assert post.kind == "post" and post.thickness == pytest.approx(breadth, rel=0.12)
    assert post.pixel_volume().sum() == pytest.approx(np.pi / 4 * breadth**2 * 50.0 / FOCAL, rel=0.1)
    middle, rim = post.front[35, 42:44].mean(), post.front[35, [38, 47]].mean()
    assert 0.2 * breadth < rim - middle < 0.5 * breadth and np.median(post.front[post.mask]) == pytest.approx(1.0, abs=1e-3)
    strip = relief_of(seen, thickness=0.1 * breadth)
    assert strip.kind == "plate" and np.ptp(strip.front[strip.mask]) < 1e-6
    thick = relief_of(seen, thickness=0.8 * breadth)
    assert thick.kind == "post" and thick.thickness == pytest.approx(0.8 * breadth, rel=0.06)


def test_a_thin_round_thing_is_a_disc() -> None:
    rows, columns = np.mgrid[:72, :96]
    puck = observed((rows - 36) ** 2 + (columns - 48) ** 2 <= 400, 1.0)
    diameter = 40.0 / FOCAL
    disc = relief_of(puck, thickness=0.15 * diameter)
    assert disc.kind == "plate" and np.ptp(disc.front[disc.mask]) < 1e-6
    assert (disc.back - disc.front)[disc.mask] == pytest.approx(0.15 * diameter, rel=0.05)
    assert relief_of(puck, thickness=0.9 * diameter).kind == "ball"


@pytest.mark.parametrize("count", [60, 200, 450])
def test_plate_volume_number_and_layers(plate, count: int) -> None:
    relief = relief_of(plate, thickness=0.02)
    particles = fill(relief, count)
    assert particles.volume.sum() == pytest.approx(relief.pixel_volume().sum(), rel=1e-12)
    # The plane z = 1 + 0.5 x: its area is the pixels' area divided by the cosine, its thickness is across the plane.
    slope = (np.arange(30, 70) - 47.5) / FOCAL
    z = 1.0 / (1.0 - 0.5 * slope)
    # dA = z^3 / (f^2 z_plane n.e) with the plane's distance 1 / sqrt(1.25) from the camera
    area = 24 * (z**3 / FOCAL**2).sum() * np.sqrt(1.25)
    assert particles.volume.sum() == pytest.approx(0.02 * area, rel=0.08)
    assert (particles.volume > 0).all()
    assert abs(len(particles.x) - count) <= 0.25 * count


def test_thin_body_has_two_layers(plate) -> None:
    particles = fill(relief_of(plate), 300)
    centred = particles.x - particles.x.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][-1]
    offset = centred @ normal
    assert (offset > 0).mean() == pytest.approx(0.5, abs=0.05)
    assert np.abs(offset).min() > 0.1 * np.abs(offset).max()


def test_small_ball_is_round(ball) -> None:
    relief = relief_of(ball)
    particles = fill(relief, 600)
    assert 24 <= len(particles.x) <= 200
    extent = np.ptp(particles.x, axis=0)
    assert extent.max() / extent.min() < 1.3
    radius = np.sqrt(ball.masks[0].sum() / np.pi) / FOCAL
    assert particles.volume.sum() == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=0.15)
    centre = np.average(particles.x, axis=0, weights=particles.volume)
    # Front view from (0, -1, 0): the ball's middle is at distance 1, at the frame's centre plus half a pixel.
    assert centre == pytest.approx([0.5 / FOCAL, 0.0, -0.5 / FOCAL], abs=0.02 * radius)


@pytest.mark.parametrize("measured", [True, False])
def test_a_near_ball_off_the_axis(measured: bool) -> None:
    eye, middle, radius = camera(0.0), np.array([0.12, -0.05, 0.6]), 0.15
    rows, columns = np.mgrid[:72, :96]
    ray = np.stack([(columns - eye.cx) / FOCAL, (rows - eye.cy) / FOCAL, np.ones((72, 96))], axis=-1)
    along = ray @ middle / (ray**2).sum(-1)
    root = along**2 - (middle @ middle - radius**2) / (ray**2).sum(-1)
    near = along - np.sqrt(np.maximum(root, 0.0))
    seen = observed(root > 0.0, near if measured else middle[2], camera=eye)
    relief = relief_of(seen)
    assert relief.kind == "ball" and relief.thickness == pytest.approx(2.0 * radius, rel=0.05)
    particles = fill(relief, 500)
    assert abs(len(particles.x) - 500) < 125
    assert particles.volume.sum() == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=0.02)
    # The far half of a near ball fills more pixels' rays than the near one: its mass counts as much all the same.
    centre = eye.camera_to_world[:3, :3] @ middle + eye.camera_to_world[:3, 3]
    assert np.average(particles.x, axis=0, weights=particles.volume) == pytest.approx(centre, abs=0.01 * radius)
    spread = np.sqrt(np.average(((particles.x - centre) ** 2).sum(axis=1), weights=particles.volume))
    assert spread == pytest.approx(np.sqrt(0.6) * radius, rel=0.03)
    assert np.median(particles.volume) == pytest.approx(particles.spacing**3, rel=0.1)


def test_thickness_overrides_the_guess(plate, ball) -> None:
    thin, thick = (fill(relief_of(plate, thickness=t), 300).volume.sum() for t in (0.01, 0.02))
    assert thick == pytest.approx(2.0 * thin, rel=0.05)
    flat, tall = (relief_of(ball, thickness=t).pixel_volume().sum() for t in (0.02, 0.04))
    assert tall == pytest.approx(2.0 * flat, rel=0.05)
    with pytest.raises(ObjectError):
        relief_of(plate, thickness=-1.0)


def test_filling_a_body_heeds_a_cancel(plate) -> None:
    calls = iter(range(3))
    with pytest.raises(Cancelled):
        fill(relief_of(plate), 300, progress=Progress(cancelled=lambda: next(calls, None) is None))
    assert next(calls, None) is None


def test_pin_holds_all_layers(plate) -> None:
    pin = np.zeros_like(plate.masks[0])
    pin[:, :40] = True
    particles = fill(relief_of(plate), 400, pin)
    xy, _ = plate.camera.project(particles.x)
    assert particles.pinned[xy[:, 0] < 37].all()
    assert not particles.pinned[xy[:, 0] > 43].any()
    speck = np.zeros_like(pin)
    speck[30, 50] = True
    assert fill(relief_of(plate), 100, speck).pinned.any()
    with pytest.raises(ObjectError, match="off the object"):
        fill(relief_of(plate), 100, np.roll(speck, -40, axis=1))


def test_objects_that_cannot_be_built(plate) -> None:
    empty = dataclasses.replace(plate, masks=np.zeros_like(plate.masks))
    with pytest.raises(ObjectError, match="empty"):
        relief_of(empty)
    tiny = np.zeros_like(plate.masks)
    tiny[:, 30:33, 40:43] = True
    with pytest.raises(ObjectError, match="pixels"):
        relief_of(dataclasses.replace(plate, masks=tiny))
    with pytest.raises(ObjectError, match="depth"):
        relief_of(dataclasses.replace(plate, depth=np.full_like(plate.depth, np.inf)))
    with pytest.raises(ObjectError, match="depth map is"):
        relief_of(dataclasses.replace(plate, depth=plate.depth[:10]))
    with pytest.raises(ObjectError):
        fill(relief_of(plate), 0)


def test_holes_in_the_depth_are_filled(plate) -> None:
    holes = plate.depth.copy()
    holes[25:28, 35:39] = np.inf
    holes[30, 50] = -1.0
    whole, mended = relief_of(plate), relief_of(dataclasses.replace(plate, depth=holes))
    assert np.isfinite(mended.front).all()
    assert np.abs(mended.front - whole.front)[whole.mask].max() < 0.03


def test_particles_have_the_second_moments_of_the_body_they_fill() -> None:
    dots = (np.indices((40, 40, 80)).reshape(3, -1).T + 0.5) / 100.0  # a block of 0.4 x 0.4 x 0.8 m, in 4 x 2 x 4 cells
    cell = np.unique(np.floor(dots / [0.1, 0.2, 0.2] + 1e-9).astype(int), axis=0, return_inverse=True)[1].ravel()
    size = np.bincount(cell).astype(float)
    centre = np.stack([np.bincount(cell, column) / size for column in dots.T], axis=1)
    moved = spread(centre, size, dots, np.ones(len(dots)))
    np.testing.assert_allclose(np.cov(moved.T, ddof=0), np.cov(dots.T, ddof=0), atol=1e-9)
    np.testing.assert_allclose(moved.mean(axis=0), dots.mean(axis=0), atol=1e-12)
    # One layer stays one layer, spread within its plane; one cell stays where it is.
    flat = spread(np.where(np.arange(3) == 2, 0.4, centre), size, dots, np.ones(len(dots)))
    np.testing.assert_allclose(np.cov(flat.T, ddof=0), np.diag([*np.diag(np.cov(dots.T, ddof=0))[:2], 0.0]), atol=1e-9)
    np.testing.assert_array_equal(spread(dots[:1], size[:1], dots[:1], size[:1]), dots[:1])
