"""Rounded bodies: their thickness behind the front, and which part is held. They are drawn by marching rays through distance functions."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import ndimage

from seeing_wind.engine.observe.object.shape.inflate import balls, inflate
from seeing_wind.engine.observe.object.shape.particles import fill
from seeing_wind.engine.observe.object.shape.relief import relief_of
from seeing_wind.engine.records import Camera
from tests.engine.observations import observed

PIXEL = 1.0 / 400.0
STEP = 0.002
"""Step of the march along each ray [m]; the bodies are at least 0.04 m thick."""
HEAD, STEM = 0.075, 0.022
Distance = Callable[[np.ndarray], np.ndarray]


def looking_down(degrees: float) -> Camera:
    """A camera 1 m from the origin that looks at it, `degrees` downwards. The image's y points down, the world's -y up."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, c, s], [0, -s, c]]
    pose[:3, 3] = -pose[:3, 2]
    return Camera(240, 240, 400.0, 400.0, 119.5, 119.5, pose)


def drawn(inside: Distance, camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mask, depth of the front, and thickness along the view, each (H, W), of the body in which `inside` is negative."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    xy = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    steps = np.arange(0.8, 1.2, STEP)
    within = np.stack([inside(camera.unproject(xy, np.full(len(xy), z))) < 0.0 for z in steps])
    mask = within.any(axis=0).reshape(rows.shape)
    near, thick = steps[within.argmax(axis=0)].reshape(rows.shape), STEP * within.sum(axis=0).reshape(rows.shape)
    return mask, np.where(mask, near, 1.0), np.where(mask, thick, 0.0)


def lollipop(flat: float) -> Distance:
    """A head on a stem, both `flat` times as deep as broad."""

    def distance(x: np.ndarray) -> np.ndarray:
        x = x / [1.0, 1.0, flat]
        stem = np.linalg.norm(x - np.clip(x @ [0, 1, 0], 0.0, 0.2)[:, None] * [0, 1, 0], axis=1) - STEM
        return np.minimum(np.linalg.norm(x - [0, -0.06, 0], axis=1) - HEAD, stem)

    return distance


@pytest.fixture(scope="module")
def round_lollipop() -> tuple[Camera, np.ndarray, np.ndarray, np.ndarray]:
    """A round lollipop seen straight on: the camera and the results of `drawn`."""
    camera = looking_down(0.0)
    return camera, *drawn(lollipop(1.0), camera)


@pytest.mark.parametrize("flat", [1.0, 0.5, pytest.param(1.3, marks=pytest.mark.slow)])
def test_head_and_stem_are_as_deep_as_they_are(flat) -> None:
    camera = looking_down(0.0)
    mask, front, thick = drawn(lollipop(flat), camera)
    relief = relief_of(observed(mask, front, camera=camera))
    assert relief.kind == "solid"
    found = relief.back - relief.front
    for rows in (slice(80, 110), slice(150, 190)):  # the head, the stem; perspective hides a little of a head's front
        assert found[rows][mask[rows]].sum() == pytest.approx(thick[rows].sum(), rel=0.2)
    volume = (thick * (front + thick / 2) ** 2)[mask].sum() * PIXEL**2
    assert relief.pixel_volume().sum() == pytest.approx(volume, rel=0.15)


def test_an_even_front_does_not_bulge(round_lollipop) -> None:
    camera, mask, front, _ = round_lollipop
    rows, columns = np.mgrid[:240, :240]
    tilted = 1.0 + 3e-4 * columns + 5e-4 * rows
    assert abs(inflate(tilted, mask, PIXEL).bulge) < 0.02
    assert relief_of(observed(mask, tilted, camera=camera)).kind == "plate"
    assert inflate(np.where(mask, front, 1.0), mask, PIXEL).bulge == pytest.approx(1.0, abs=0.15)


def test_balls_fill_a_disc_and_a_bar() -> None:
    rows, columns = np.mgrid[:80, :120]
    square = (rows - 40.0) ** 2 + (columns - 50.0) ** 2
    disc = balls(square <= 30.0**2)
    inner = square <= 27.0**2
    np.testing.assert_allclose(disc.half[inner], np.sqrt(30.0**2 - square[inner]), atol=1.3)
    bar = balls((abs(rows - 40) <= 8) & (columns > 5) & (columns < 115))
    assert bar.half[40, 20:100] == pytest.approx(8.5, abs=0.6) and bar.half[46, 60] < 7.0
    assert not balls(np.zeros((5, 5), bool)).half.any()


def test_a_cup_is_held_up_to_its_border_also_behind_it() -> None:
    """Seen from above, rays of the rim that is not painted run down behind the part that is."""
    camera = looking_down(25.0)

    def cup(x: np.ndarray) -> np.ndarray:
        return np.maximum(np.hypot(x[:, 0], x[:, 2]) - 0.08, np.abs(x[:, 1]) - 0.1)

    mask, front, _ = drawn(cup, camera)
    rows, columns = np.nonzero(mask)
    places = camera.unproject(np.stack([columns, rows], axis=1).astype(float), front[rows, columns])
    held = np.zeros(mask.shape, bool)
    held[rows, columns] = places[:, 1] > 0.0  # -y is up: the lower half
    particles = fill(relief_of(observed(mask, front, camera=camera)), 600, held)
    below = particles.x[:, 1]
    assert particles.pinned[below > particles.spacing].all() and not particles.pinned[below < -particles.spacing].any()


def test_a_border_across_the_view_goes_straight_back_and_two_ends_are_held_along_the_rays() -> None:
    camera = looking_down(0.0)

    def bar(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm(x - np.clip(x[:, :1], -0.15, 0.15) * [1, 0, 0], axis=1) - 0.04

    mask, front, _ = drawn(bar, camera)
    relief = relief_of(observed(mask, front, camera=camera))
    for border in ([70], [70, 170]):
        held = np.zeros(mask.shape, bool)
        held[:, : border[0]] = True
        held[:, border[1] if len(border) > 1 else 240 :] = True
        particles = fill(relief, 400, held)
        at = camera.project(particles.x, 0)[0][:, 0]
        cell = particles.spacing / PIXEL
        sure = np.min([abs(at - b) for b in border], axis=0) > cell
        inside = (at < border[0]) | ((at > border[1]) if len(border) > 1 else False)
        np.testing.assert_array_equal(particles.pinned[sure], inside[sure])


def test_a_rim_at_the_depth_of_what_is_behind_makes_no_solid(round_lollipop) -> None:
    """Depth maps blur the outermost pixels; a flat leaf stays flat, and a solid body no thicker than half as much again."""
    camera, mask, front, thick = round_lollipop
    edge = mask & ~ndimage.binary_erosion(mask)
    for leak in (0.05, 0.3):
        assert relief_of(observed(mask, np.where(edge, 1.0 + leak, 1.0 + 3e-4 * np.arange(240)), camera=camera)).kind == "plate"
        relief = relief_of(observed(mask, np.where(edge, front + leak, front), camera=camera))
        assert (relief.back - relief.front)[mask].sum() < 1.6 * thick.sum()


def test_a_lamp_on_a_thin_stick_is_no_ball_and_a_bun_is_flatter_than_one() -> None:
    rows, columns = np.mgrid[:240, :240].astype(float)
    camera, lamp = looking_down(0.0), (rows - 70) ** 2 + (columns - 120) ** 2
    dome = np.sqrt(np.maximum(50.0**2 - lamp, 0.0))
    stick = (abs(columns - 120) <= 5) & (rows > 70) & (rows < 230)
    half = np.maximum(dome, np.where(stick, np.sqrt(np.maximum(30.0 - (columns - 120) ** 2, 0.0)), 0.0))
    relief = relief_of(observed((half > 0.0), 1.0 - half * PIXEL, camera=camera))
    assert relief.kind == "solid"
    assert np.median((relief.back - relief.front)[180:220, 120]) == pytest.approx(11.0 * PIXEL, rel=0.35)
    bun = relief_of(observed(lamp < 50.0**2, 1.0 - 0.5 * dome * PIXEL, camera=camera))
    assert bun.kind == "solid" and bun.thickness == pytest.approx(50.0 * PIXEL, rel=0.2)


@pytest.mark.parametrize("row", [49, 50, 51])
def test_one_painted_pixel_holds_something(row, round_lollipop) -> None:
    camera, mask, front, _ = round_lollipop
    pin = np.zeros(mask.shape, bool)
    pin[row + 50, 121] = True
    held = fill(relief_of(observed(mask, front, camera=camera)), 200, pin)
    assert 1 <= held.pinned.sum() <= 3
    assert abs(camera.project(held.x[held.pinned])[0] - [121, row + 50]).max() < held.spacing / PIXEL


def test_a_stray_depth_is_not_the_object(round_lollipop) -> None:
    camera, mask, front, _ = round_lollipop
    stray = front.copy()
    stray[90, 118:121] = 1e4
    clean, found = (relief_of(observed(mask, z, camera=camera)) for z in (front, stray))
    assert found.kind == "solid" and found.thickness == pytest.approx(clean.thickness, rel=0.02)
