"""The look over the whole clip: what turns into view, light that changes, and what a wrong motion may not spoil."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import Rotation

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.look.contributions import contributions
from seeing_wind.engine.look.covering import cover_bare_surface, joined
from seeing_wind.engine.look.gaussians import FLATTENING, SH0
from seeing_wind.engine.look.over_clip import BANDS, Footage, fit_appearance
from seeing_wind.engine.look.splatting import render_gaussians
from seeing_wind.engine.masks import Masks
from seeing_wind.engine.materials import Material
from seeing_wind.engine.observe.object.motion.control import attach
from seeing_wind.engine.observe.object.shape.visibility import seen_surface
from seeing_wind.engine.progress import Cancelled, Progress
from seeing_wind.engine.records import Attachment, Body, Camera, Gaussians, Outcome, Particles, Recovery, Surface

from .test_gaussians_ply import self_attached

SIZE = (0.4, 0.3, 0.3)
"""Of a box along x, y (away from the camera) and z [m]."""
CAMERA = Camera(64, 48, 110.0, 110.0, 31.5, 23.5, front_view(2.0))
WALL = 90
FRONT, SIDE = np.array([0.8, 0.3, 0.2]), np.array([0.2, 0.4, 0.9])
TURN = np.radians([0.0, 14.0, 28.0, 42.0, 56.0])
"""Of the box in five frames, about the vertical, its right side coming into view."""


def box() -> Surface:
    """A closed box of twelve triangles, normals outward."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * SIZE
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([part for a, b, c, d in quads for part in ((a, b, c), (a, c, d))])
    return Surface(corners, triangles, np.zeros((8, 2)), attach(corners, lattice()))


def lattice() -> np.ndarray:
    axes = [np.linspace(-0.5, 0.5, 3) * side for side in SIZE]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def motion(turns: np.ndarray = TURN) -> Recovery:
    """The box turned about the vertical."""
    rotation = Rotation.from_euler("z", -turns[:, None]).as_matrix()
    x, count = lattice(), len(turns)
    return Recovery(
        outcome=Outcome.CONVERGED, force_density=np.zeros((count - 1, len(x), 3)), deviation=np.zeros((count - 1, len(x), 3)),
        x=np.einsum("tab,nb->tna", rotation, x), F=np.repeat(rotation[:, None], len(x), axis=1), v0=np.zeros_like(x),
        residual=np.zeros(count), residual_unit="px", iterations=1, seconds=0.0,
    )  # fmt: skip


def filmed(found: Recovery, light: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frames (T+1, H, W, 3) and masks of the box before a grey wall: front and right side of one colour each, times `light` (T+1,)."""
    surface, whole = box(), np.ones((CAMERA.height, CAMERA.width), bool)
    frames = np.full((len(found.x), CAMERA.height, CAMERA.width, 3), float(WALL))
    masks = np.zeros(frames.shape[:3], bool)
    for t, x in enumerate(found.x):
        seen = seen_surface(surface.attachment.follow(x), surface.triangles, CAMERA, t, surface.vertices, whole)
        column, row = seen.pixel.T
        masks[t, row, column] = True
        side = np.where((seen.normal[:, :1] > 0.5), SIDE, FRONT)
        frames[t, row, column] = 255.0 * light[t] * side
    return np.clip(frames.round(), 0, 255).astype(np.uint8), masks


def front_only() -> Body:
    """A body that has Gaussians, of the front's colour, on its front alone."""
    pixel = (2.0 - 0.5 * SIZE[1]) / CAMERA.fx
    x, z = (axis.ravel() for axis in np.meshgrid(*(np.arange(-0.5 * side + 0.5 * pixel, 0.5 * side, pixel) for side in (SIZE[0], SIZE[2]))))
    points = np.stack([x, np.full_like(x, -0.5 * SIZE[1]), z], axis=1)
    turned = Rotation.from_euler("x", 90.0, degrees=True).as_quat()[[3, 0, 1, 2]]  # the third axis towards the camera
    gaussians = Gaussians(
        x=points, scale=np.tile(0.5 * pixel * np.array([1.0, 1.0, FLATTENING]), (len(x), 1)), rotation=np.tile(turned, (len(x), 1)),
        opacity=np.full(len(x), 0.9), sh=np.tile((FRONT - 0.5) / SH0, (len(x), 1, 1)), attachment=attach(points, lattice()),
    )  # fmt: skip
    particles = Particles(lattice(), np.full(27, 1e-4), np.zeros(27, bool), 0.1)
    keypoints = Attachment(np.zeros((1, 1), np.int32), np.ones((1, 1)))
    material = Material("clay", "von_mises", 1500.0, 1e5, 0.3, 1e3, 0.0, "")
    return Body(particles, material, gaussians, box(), keypoints, np.zeros((len(TURN), 1, 3)))


def drawn(body: Body, gaussians: Gaussians, found: Recovery, t: int) -> np.ndarray:
    colour, alpha = render_gaussians(gaussians, CAMERA, t, found.x[t], found.F[t])
    return 255.0 * colour + (1.0 - alpha[..., None]) * WALL


def footage(frames: np.ndarray, masks: np.ndarray) -> Footage:
    wall = np.full(frames.shape[1:], WALL, np.uint8)
    return Footage(CAMERA, lambda t: frames[t], Masks.of(masks), lambda t, image, box: wall[box[1] : box[3], box[0] : box[2]])


def off(want: np.ndarray, got: np.ndarray, mask: np.ndarray) -> float:
    """Root mean square difference [grey levels] in a mask without its outline, whose pixels Gaussians show softly."""
    return float(np.sqrt(((want.astype(float) - got)[ndimage.binary_erosion(mask, iterations=2)] ** 2).mean()))


def test_the_surface_in_a_pixel_is_the_nearest_one() -> None:
    surface, mask = box(), np.ones((CAMERA.height, CAMERA.width), bool)
    seen = seen_surface(surface.vertices, surface.triangles, CAMERA, 0, surface.vertices, mask)
    at, depth = CAMERA.project(seen.place)
    assert at == pytest.approx(seen.pixel, abs=1e-9)
    assert depth == pytest.approx(2.0 - 0.5 * SIZE[1]), "the front, which hides all else"
    assert seen.normal == pytest.approx(np.tile([0.0, -1.0, 0.0], (len(at), 1)))
    wide, high = (CAMERA.fx * side / (2.0 - 0.5 * SIZE[1]) for side in (SIZE[0], SIZE[2]))
    assert len(at) == 2 * round(wide / 2.0) * 2 * round(high / 2.0), "its middle lies between four pixels"
    pixel = (2.0 - 0.5 * SIZE[1]) / CAMERA.fx
    assert seen.right == pytest.approx(np.tile([pixel, 0.0, 0.0], (len(at), 1))) and seen.down[:, 2] == pytest.approx(-pixel)
    moved = surface.vertices + [0.1, 0.3, 0.0]
    again = seen_surface(moved, surface.triangles, CAMERA, 0, surface.vertices, mask)
    assert CAMERA.project(again.place + [0.1, 0.3, 0.0])[0] == pytest.approx(again.pixel, abs=1e-9), "places are those of frame 0"
    behind = seen_surface(surface.vertices - [0.0, 4.0, 0.0], surface.triangles, CAMERA, 0, surface.vertices, mask)
    assert len(behind.pixel) == 0


def test_contributions_make_the_frame() -> None:
    body, found = front_only(), motion()
    weights, passed = contributions(body.gaussians, CAMERA, found.x[2], found.F[2])
    colour, alpha = render_gaussians(body.gaussians, CAMERA, 2, found.x[2], found.F[2])
    mixed = weights @ np.tile(FRONT, (len(body.gaussians.x), 1))
    assert mixed.reshape(colour.shape) == pytest.approx(colour, abs=0.02)
    assert 1.0 - passed.reshape(alpha.shape) == pytest.approx(alpha, abs=1e-5)


def test_what_is_covered_is_not_covered_again() -> None:
    body, found = front_only(), motion()
    frames, masks = filmed(found, np.ones(len(TURN)))
    assert len(cover_bare_surface(body, body.gaussians, CAMERA, masks[0], frames[0]).x) < 0.05 * len(body.gaussians.x)
    new = cover_bare_surface(body, body.gaussians, CAMERA, masks[4], frames[4], 4, found.x[4])
    right = new.x[:, 0] > 0.49 * SIZE[0]
    assert right.sum() > 60 and right.mean() > 0.7, "the side that turned into view"
    assert np.abs(new.sh[right, 0] * SH0 + 0.5 - SIDE).max() < 0.01
    both = joined(body.gaussians, new)
    assert len(cover_bare_surface(body, both, CAMERA, masks[4], frames[4], 4, found.x[4]).x) < 0.1 * len(new.x)


def test_the_back_of_a_leaf_is_not_covered_by_its_front() -> None:
    body = front_only()
    thin = dataclasses.replace(body.surface, vertices=body.surface.vertices * [1.0, 0.003, 1.0])
    front = dataclasses.replace(body.gaussians, x=body.gaussians.x * [1.0, 0.003, 1.0])
    around = np.diag([-1.0, -1.0, 1.0, 1.0]) @ CAMERA.pose(0)
    behind = dataclasses.replace(CAMERA, camera_to_world=around)
    mask, image = np.ones((48, 64), bool), np.zeros((48, 64, 3), np.uint8)
    leaf = dataclasses.replace(body, surface=thin)
    assert len(cover_bare_surface(leaf, front, CAMERA, mask, image).x) < 20
    assert len(cover_bare_surface(leaf, front, behind, mask, image).x) > 300


def test_sides_and_light_of_the_whole_clip() -> None:
    body, found = front_only(), motion()
    light = 0.4 + 0.6 * np.cos(TURN)
    frames, masks = filmed(found, light)
    told: list[float] = []
    fitted = fit_appearance(body, found, footage(frames, masks), Progress(lambda message: told.append(message["fraction"])))
    assert told == sorted(told) and len(told) > 10
    assert fitted.sh.shape[1:] == (BANDS, 3) and len(fitted.x) > len(body.gaussians.x)
    errors = np.array([[off(frames[t], drawn(body, one, found, t), masks[t]) for one in (body.gaussians, fitted)] for t in range(5)])
    # What is left is the crease between the sides, that Gaussians show softly.
    assert (errors[2:, 0] > 25.0).all() and (errors[:, 1] < np.maximum(0.35 * errors[:, 0], 4.0)).all(), errors
    between = motion(np.radians([0.0, 35.0]))
    want, mask = filmed(between, 0.4 + 0.6 * np.cos(np.radians([0.0, 35.0])))
    assert off(want[1], drawn(body, fitted, between, 1), mask[1]) < 15.0, "a turn that was not filmed"


def test_frames_that_the_motion_misses_hardly_count() -> None:
    body, found = front_only(), motion(np.zeros(5))
    frames, masks = filmed(found, np.ones(5))
    frames[3:] = WALL  # the object went away, the simulation did not
    trusted = dataclasses.replace(found, residual=np.array([0.0, 0.1, 0.1, 30.0, 40.0]))
    blind = fit_appearance(body, found, footage(frames, masks))
    told = fit_appearance(body, trusted, footage(frames, masks))
    errors = [off(frames[0], drawn(body, one, found, 0), masks[0]) for one in (told, blind)]
    assert errors[0] < 5.0 and errors[1] > 3.0 * errors[0]


def test_nothing_to_fit_and_cancelling() -> None:
    body, found = front_only(), motion()
    frames, masks = filmed(found, np.ones(5))
    lost = dataclasses.replace(found, residual=np.full(5, np.nan))
    assert fit_appearance(body, lost, footage(frames, masks)) is body.gaussians
    asked: list[int] = []
    with pytest.raises(Cancelled):
        fit_appearance(body, found, footage(frames, masks), Progress(cancelled=lambda: len(asked) > 7 or bool(asked.append(1))))
    assert len(asked) == 8


def test_gaussians_without_particles_can_be_drawn_as_contributions() -> None:
    gaussians = front_only().gaussians
    alone = dataclasses.replace(gaussians, attachment=self_attached(len(gaussians.x)))
    identity = np.tile(np.eye(3), (len(gaussians.x), 1, 1))
    far = dataclasses.replace(CAMERA, camera_to_world=front_view(2.0) + np.array([[0, 0, 0, 50.0], *np.zeros((3, 4))]))
    weights, passed = contributions(alone, far, gaussians.x, identity)
    assert weights.nnz == 0 and (passed == 1.0).all(), "out of the frame"
