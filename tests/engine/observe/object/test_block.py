"""Blocks: boxes that are seen at an angle, drawn by marching rays through their distance function."""

import numpy as np
import pytest
import scipy.spatial.transform

from seeing_wind.engine.observe.object.shape.block import find_block
from seeing_wind.engine.observe.object.shape.particles import fill
from seeing_wind.engine.observe.object.shape.relief import relief_of
from seeing_wind.engine.observe.object.shape.surface import surface_of
from seeing_wind.engine.records import Camera
from tests.engine.observations import observed

EYE = Camera(288, 216, 470.0, 470.0, 143.5, 107.5, np.eye(4))
PLATE, POST = (0.22, 0.16, 0.03), (0.06, 0.06, 0.38)


def turned(x, y=0.0, z=0.0):
    return scipy.spatial.transform.Rotation.from_euler("zyx", [z, y, x], degrees=True).as_matrix()


def drawn(sides, turn, rounding=0.0, noise=0.0, middle=(0.02, -0.01, 1.0)):
    """Mask and depth of a box with `sides` [m], whose axes are the columns of `turn` and whose edges have the radius `rounding` [m]."""
    rows, columns = np.mgrid[: EYE.height, : EYE.width]
    xy = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    z, gap, going = np.full(len(xy), 0.5), np.full(len(xy), np.inf), np.arange(len(xy))
    inner = np.array(sides) / 2 - rounding
    for _ in range(80):
        q = np.abs((EYE.unproject(xy[going], z[going]) - middle) @ turn) - inner
        gap[going] = np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0) - rounding
        z[going] += gap[going]
        going = going[(np.abs(gap[going]) > 1e-9) & (z[going] < 2.0 * middle[2])]  # neither there nor past it
    mask = (gap < 2e-4).reshape(rows.shape)
    depth = z.reshape(rows.shape) + noise * np.random.default_rng(0).standard_normal(rows.shape)
    return mask, np.where(mask, depth, np.inf)


def block_of(mask, depth):
    return find_block(np.where(mask, depth, 1.0), mask, EYE)


@pytest.mark.parametrize(
    ("sides", "turn"),
    [(PLATE, turned(50)), (PLATE, turned(40, 25, 15)), (PLATE, turned(70, 5)), (POST, turned(80, 0, 25)), (POST, turned(100, 10, 60))],
)
def test_a_box_seen_at_an_angle_is_built_as_it_is(sides, turn) -> None:
    relief = relief_of(observed(*drawn(sides, turn), camera=EYE))
    particles = fill(relief, 600)
    assert relief.kind == "block" and abs(len(particles.x) - 600) < 180
    # The mass, where it is, and how it is spread along the true axes: what weighs, and what bends.
    assert particles.volume.sum() == pytest.approx(np.prod(sides), rel=0.06)
    local = (particles.x - [0.02, -0.01, 1.0]) @ turn
    np.testing.assert_allclose(np.average(local, axis=0, weights=particles.volume), 0.0, atol=0.002)
    inside = np.abs(local) / (np.array(sides) / 2)
    assert inside.max() < 1.03 and (inside.max(axis=0) > 0.45).all()
    # The lattice lies along the box: each of its directions is one of the box's, up to its sign.
    np.testing.assert_allclose(np.sort(np.abs(relief.block.frame() @ turn), axis=1), [[0, 0, 1]] * 3, atol=0.02)


@pytest.mark.parametrize(("sides", "turn"), [(PLATE, turned(50)), (POST, turned(80, 0, 25))])
def test_rounded_edges_and_a_noisy_depth_leave_its_thickness(sides, turn) -> None:
    for rounding, noise in ((0.006, 0.0), (0.0, 0.001)):
        found = block_of(*drawn(sides, turn, rounding, noise))
        assert found is not None and found.depth == pytest.approx(min(sides), rel=0.07)


@pytest.mark.parametrize("turn", [turned(80, 0, 20), turned(80, 0, 40), turned(100, 10, 60)])
def test_a_square_post_with_rounded_edges_is_as_wide_as_deep(turn) -> None:
    # The outline touches the round edges short of the post's width; a post 7 % too narrow would be 20 % too soft that way.
    particles = fill(relief_of(observed(*drawn(POST, turn, 0.007), camera=EYE)), 600)
    local = (particles.x - [0.02, -0.01, 1.0]) @ turn
    width, depth = np.sqrt(np.average(local**2, axis=0, weights=particles.volume))[:2]
    assert width == pytest.approx(depth, rel=0.04) and 0.015 < width < 0.018
    assert particles.volume.sum() == pytest.approx(0.06**2 * 0.38, rel=0.05)


def test_a_rounded_edge_is_no_third_side() -> None:
    particles = fill(relief_of(observed(*drawn((0.15, 0.15, 0.15), turned(10, 45), 0.02), camera=EYE)), 600)
    assert 0.9 < particles.volume.sum() / 0.15**3 < 1.02
    assert (np.abs((particles.x - [0.02, -0.01, 1.0]) @ turned(10, 45)) < 0.079).all()


def test_a_small_sharp_box_is_not_taken_for_a_rounded_one() -> None:
    for sides, turn, middle in ((PLATE, turned(50), (0.02, -0.01, 2.0)), (POST, turned(80, 0, 25), (0.02, -0.01, 2.0))):
        relief = relief_of(observed(*drawn(sides, turn, middle=middle), camera=EYE))
        assert relief.kind == "block" and set(relief.block.stretch) == {1.0}
        assert relief.pixel_volume().sum() == pytest.approx(np.prod(sides), rel=0.1)


def test_what_is_no_block_is_left_to_the_other_rules() -> None:
    assert block_of(*drawn(PLATE, np.eye(3))) is None  # face-on: no side is seen
    assert block_of(*drawn((0.2, 0.2, 0.2), np.eye(3), rounding=0.0999)) is None  # a ball
    assert block_of(*drawn((0.3, 0.06, 0.06), turned(30), rounding=0.0299)) is None  # a rod
    rows, columns = np.mgrid[: EYE.height, : EYE.width].astype(float)
    mask = (abs(rows - 108) < 72) & (abs(columns - 144) < 90)
    assert block_of(mask, 1.0 + 0.03 * np.sin(columns / 16)) is None  # a sheet with folds
    # The inside of a corner: two walls at a right angle, and what is behind them is not known.
    assert block_of(mask, 1.0 + 0.002 * (90 - abs(columns - 144))) is None


def test_a_given_thickness_overrides_what_the_sides_say() -> None:
    seen = observed(*drawn(PLATE, turned(50)), camera=EYE)
    relief = relief_of(seen, thickness=0.015)
    assert relief.kind == "block" and relief.thickness == 0.015
    assert fill(relief, 600).volume.sum() == pytest.approx(0.22 * 0.16 * 0.015, rel=0.08)


def test_it_is_held_straight_behind_what_is_painted() -> None:
    turn = turned(80, 0, 25)
    mask, depth = drawn(POST, turn)
    points = EYE.unproject(np.argwhere(mask)[:, ::-1].astype(float), depth[mask])
    along = ((points - [0.02, -0.01, 1.0]) @ turn)[:, 2]
    pin = np.zeros_like(mask)
    pin[mask] = along > 0.10  # a border that is no multiple of the spacing
    seen = observed(mask, depth, camera=EYE)
    particles = fill(relief_of(seen), 600, pin)
    height = ((particles.x - [0.02, -0.01, 1.0]) @ turn)[:, 2]
    held, free = height[particles.pinned].min(), height[~particles.pinned].max()
    # No particle in front of the border is held and none behind it free, and a layer of cells ends at it.
    assert free < 0.10 < held and 0.5 * (held + free) == pytest.approx(0.10, abs=0.002)


def test_paint_that_slants_holds_a_block_straight_across() -> None:
    turn = turned(80, 0, 25)
    mask, depth = drawn(POST, turn)
    points = EYE.unproject(np.argwhere(mask)[:, ::-1].astype(float), depth[mask])
    local = (points - [0.02, -0.01, 1.0]) @ turn
    face = np.abs(local[:, 0]) > 0.0299  # as large as the side beside it, of which the view shows less
    pin = np.zeros_like(mask)
    pin[mask] = local[:, 2] > np.where(face, 0.11, 0.09)
    assert 0.2 < face.mean() < 0.8
    particles = fill(relief_of(observed(mask, depth, camera=EYE)), 600, pin)
    height = ((particles.x - [0.02, -0.01, 1.0]) @ turn)[:, 2]
    held, free = height[particles.pinned].min(), height[~particles.pinned].max()
    assert free < held and 0.5 * (held + free) == pytest.approx(0.10, abs=0.003)


def test_the_mesh_of_a_block_is_closed_and_has_its_volume() -> None:
    trimesh = pytest.importorskip("trimesh")
    relief = relief_of(observed(*drawn(PLATE, turned(40, 25)), camera=EYE))
    surface = surface_of(relief, fill(relief, 300).x)
    mesh = trimesh.Trimesh(surface.vertices, surface.triangles, process=False)
    assert mesh.is_watertight and mesh.volume == pytest.approx(np.prod(PLATE), rel=0.1)
