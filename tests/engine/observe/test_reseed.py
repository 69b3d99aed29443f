"""A body that turns around: new tracks on the side that frame 0 did not show, and where they are on the body."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from interrupted import assert_same, in_pieces
from scenes import HEIGHT, WIDTH, noise, write_video

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.observe import observe
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Body, Camera, Observation
from seeing_wind.engine.settings import BuildSettings, ObserveSettings
from seeing_wind.engine.stages import build_body, track_targets

SIDE, DEPTH, FOCAL, DISTANCE, FRAMES = 0.30, 0.03, 300.0, 1.0, 14
"""Side and thickness [m] of a square board, focal length [px], distance [m], and number of frames in which the board turns by 160 degrees
about an upright axis."""

ANGLES = np.radians(np.linspace(0.0, 160.0, FRAMES))
CAMERA = Camera(WIDTH, HEIGHT, FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, front_view(DISTANCE))


def turned(points: np.ndarray, t: int) -> np.ndarray:
    """Points (K, 3) [m] of the board as they are in frame t, in world axes; the camera looks along +Y."""
    c, s = np.cos(ANGLES[t]), np.sin(ANGLES[t])
    return points @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T


def corners() -> dict[str, np.ndarray]:
    """The four corners (4, 3) of each face that may be seen, in the order of its texture's corners; outward normals follow from them."""
    a, d = 0.5 * SIDE, 0.5 * DEPTH
    return {
        "front": np.array([[-a, -d, a], [a, -d, a], [a, -d, -a], [-a, -d, -a]]),
        "back": np.array([[a, d, a], [-a, d, a], [-a, d, -a], [a, d, -a]]),
        "right": np.array([[a, -d, a], [a, d, a], [a, d, -a], [a, -d, -a]]),
        "left": np.array([[-a, d, a], [-a, -d, a], [-a, -d, -a], [-a, d, -a]]),
    }


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """The rendered clip and its masks (T+1, H, W)."""
    rng = np.random.default_rng(4)
    behind = noise(rng, (HEIGHT, WIDTH), (70, 75, 80), (110, 115, 120), 2.0)
    sizes = {"front": (120, 120), "back": (120, 120), "right": (120, 24), "left": (120, 24)}
    texture = {name: noise(rng, size, (120, 40, 10), (255, 190, 90), 1.5).astype(np.float32) for name, size in sizes.items()}
    frames, masks = [], []
    for t in range(FRAMES):
        frame, mask = behind + rng.normal(0, 1.0, behind.shape), np.zeros((HEIGHT, WIDTH), np.float32)
        for name, face in corners().items():
            place = turned(face, t)
            normal = np.cross(place[1] - place[0], place[3] - place[0])
            if normal @ (place.mean(axis=0) - CAMERA.pose(0)[:3, 3]) <= 0.0:
                continue
            height, width = texture[name].shape[:2]
            source = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], np.float32)
            matrix = cv2.getPerspectiveTransform(source, CAMERA.project(place)[0].astype(np.float32))
            warped = cv2.warpPerspective(texture[name], matrix, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
            cover = cv2.warpPerspective(np.ones((height, width), np.float32), matrix, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
            solid = cover > 0.5
            frame[solid] = warped[solid] / cover[solid][:, None]
            mask = np.maximum(mask, cover)
        frames.append(np.clip(np.round(frame), 0, 255).astype(np.uint8))
        masks.append(mask > 0.5)
    path = tmp_path_factory.mktemp("board") / "clip.avi"
    write_video(path, frames, 30.0)
    return path, np.stack(masks)


@pytest.fixture(scope="module")
def marked(board: tuple[Path, np.ndarray]) -> ObserveSettings:
    rows, columns = np.nonzero(board[1][0])
    box = (columns.min() - 3.0, rows.min() - 3.0, columns.max() + 3.0, rows.max() + 3.0)
    return ObserveSettings(box=box, distance=DISTANCE - 0.5 * DEPTH, fov=float(np.degrees(2 * np.arctan(0.5 * WIDTH / FOCAL))))


@pytest.fixture(scope="module")
def seen(board: tuple[Path, np.ndarray], marked: ObserveSettings) -> Observation:
    return observe(board[0], marked, NoProgress())


@pytest.fixture(scope="module")
def body(seen: Observation) -> Body:
    with pytest.MonkeyPatch.context() as patch:
        # How the body looks is not asked here, and fitting it takes longest.
        patch.setattr("seeing_wind.engine.look.first_frame.fit", lambda gaussians, *_, **__: (gaussians, 40.0))
        return build_body(seen, BuildSettings(thickness=DEPTH, particles=150), NoProgress())


def back_points(xy: np.ndarray, t: int) -> np.ndarray:
    """Points (K, 3) [m] of the back face, in the board's axes, that are seen at pixels `xy` (K, 2) of frame t; NaN off the face."""
    eye = CAMERA.pose(0)[:3, 3]
    ray = CAMERA.unproject(xy, np.ones(len(xy))) - eye
    turn = turned(np.eye(3), t)  # rows: the board's axes in the world
    eye, ray = eye @ turn.T, ray @ turn.T
    at = eye + ((0.5 * DEPTH - eye[1]) / ray[:, 1])[:, None] * ray
    inside = (np.abs(at[:, [0, 2]]) < 0.5 * SIDE).all(axis=1)
    return np.where(inside[:, None], at, np.nan)


def first_of(seen: Observation) -> np.ndarray:
    return np.where(seen.visible.any(axis=0) & ~seen.on_centroid, seen.visible.argmax(axis=0), -1)


def test_masks_follow_through_the_edge(board: tuple[Path, np.ndarray], seen: Observation) -> None:
    iou = (seen.masks & board[1]).sum(axis=(1, 2)) / (seen.masks | board[1]).sum(axis=(1, 2))
    assert iou.mean() > 0.9 and iou[-1] > 0.9


def test_the_back_gets_tracks_of_its_own(seen: Observation) -> None:
    first = first_of(seen)
    late = first > 0
    assert seen.visible[-1, late].sum() > 20, "the side that frame 0 did not show is followed"
    assert not seen.visible[0, late].any() and np.isfinite(seen.xy).all()
    off = []
    for k in np.flatnonzero(late & seen.visible[-1]):
        place = back_points(seen.xy[first[k]][k][None], first[k])
        if np.isfinite(place).all():
            off.append(np.linalg.norm(CAMERA.project(turned(place, FRAMES - 1))[0] - seen.xy[-1, k]))
    assert len(off) > 10 and np.median(off) < 1.0, "followed from where they began to the end"


def test_they_are_tied_to_the_back_of_the_body(seen: Observation, body: Body) -> None:
    late = np.flatnonzero((first_of(seen) > 0) & seen.visible[-1])
    true = back_points(seen.xy[-1, late], FRAMES - 1)
    tied = body.keypoints.follow(body.particles.x)[late]
    known = np.isfinite(true).all(axis=1) & np.isfinite(body.lifted[-1, late]).all(axis=1)
    off = np.linalg.norm((tied - true)[known], axis=1)
    assert known.sum() > 10 and np.median(off) < 0.12 * SIDE
    mirrored = np.linalg.norm((tied - true * [-1.0, 1.0, 1.0])[known], axis=1)
    assert np.median(off) < 0.5 * np.median(mirrored), "not taken for points of the front"


def test_the_recovery_is_told_how_sure_the_ties_are(seen: Observation, body: Body) -> None:
    targets = track_targets(seen, body)
    first = first_of(seen)
    assert targets.offset is not None and targets.offset.shape == first.shape
    assert np.allclose(targets.offset[first == 0], 0.5) and (targets.offset[(first > 0) & targets.visible[-1]] > 0.5).all()
    assert (targets.visible <= seen.visible).all() and targets.visible[:, first == 0].sum() == seen.visible[:, first == 0].sum()


@pytest.mark.parametrize("every", [3, pytest.param(5, marks=pytest.mark.slow)])
def test_a_kill_costs_no_frame_that_was_followed(
    board: tuple[Path, np.ndarray], marked: ObserveSettings, seen: Observation, tmp_path: Path, every: int
) -> None:
    found, kills, frames = in_pieces(board[0], marked, tmp_path, every)
    assert_same(found, seen)
    # Twice through the clip, roughly and well, and nothing again.
    assert frames == 2 * (FRAMES - 1) and kills == (frames - 1) // every
