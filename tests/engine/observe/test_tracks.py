"""Tracks against known motion: corners, the centroid of small objects, files, and a rendered scene."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from interrupted import assert_same, in_pieces
from scenes import Scene, moving_body, noise, painted_scene
from scipy.interpolate import RBFInterpolator

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.following import flickers
from seeing_wind.engine.observe.steady import Steady
from seeing_wind.engine.observe.tracks.anchor import align, cut_patches
from seeing_wind.engine.observe.tracks.file import read_tracks
from seeing_wind.engine.observe.tracks.neighbours import disagreement, predict
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import ObserveSettings


def errors(seen: Observation, truth: np.ndarray) -> np.ndarray:
    """Distances [px] of visible tracks after frame 0."""
    counted = seen.visible.copy()
    counted[0] = False
    return np.linalg.norm(seen.xy - truth, axis=2)[counted]


def test_turning_disc(disc: Scene, disc_seen: Observation) -> None:
    truth = np.stack([disc.moved(disc_seen.xy[0], t) for t in range(len(disc.frames))])
    off = errors(disc_seen, truth)
    assert disc_seen.xy.shape[1] >= 60 and not disc_seen.on_centroid.any()
    assert disc_seen.visible[-1].mean() > 0.75
    assert np.median(off) < 0.2 and np.percentile(off, 90) < 0.5


def test_sigma_says_how_far_off_a_track_is(disc: Scene, disc_seen: Observation) -> None:
    truth = np.stack([disc.moved(disc_seen.xy[0], t) for t in range(len(disc.frames))])
    counted = disc_seen.visible.copy()
    counted[0] = False
    ratio = (np.linalg.norm(disc_seen.xy - truth, axis=2) / disc_seen.sigma)[counted]
    # A 2D gaussian's median distance is 1.18 sigma.
    assert 0.3 < np.median(ratio) < 2.4
    assert (disc_seen.sigma > 0).all() and np.isfinite(disc_seen.sigma).all() and np.isfinite(disc_seen.xy).all()


def test_a_rim_that_does_not_turn_is_not_followed(tmp_path: Path) -> None:
    """A plain disc with eight spots turns in a rim whose reflections stay where the light is."""
    t = np.arange(10.0)
    angles = 0.06 * t

    def body(frame: int, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
        turn = angles[frame]
        u, v = np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx
        spots = [(16 * np.cos(2.4 * k), 12 * np.sin(2.4 * k + 0.4)) for k in range(8)]
        plain = 45.0 + sum(70.0 * np.exp(-0.5 * ((u - x) ** 2 + (v - y) ** 2) / 2.2**2) for x, y in spots)
        inside = np.clip(27.5 - np.hypot(dx, dy), 0, 1)
        return np.repeat((inside * plain + (1 - inside) * (190 + 30 * np.cos(9 * np.arctan2(dy, dx))))[..., None], 3, axis=2)

    scene = painted_scene(tmp_path, np.stack([50 + 9 * t, np.full(10, 80.0)], axis=1), angles, 34.0, body)
    seen = observe(scene.path, ObserveSettings(box=scene.box, distance=1.0), NoProgress())
    off = errors(seen, np.stack([scene.moved(seen.xy[0], k) for k in range(10)]))
    assert seen.visible[-1].sum() >= 6 and not seen.on_centroid.any()
    assert np.percentile(off, 75) < 0.4


def test_alignment_recovers_a_known_affine() -> None:
    rng = np.random.default_rng(3)
    frame = cv2.GaussianBlur(rng.uniform(0, 255, (80, 80)).astype(np.float32), (0, 0), 1.5)
    affine = np.array([[1.06, 0.05], [-0.04, 0.97]])
    center, moved = np.array([40.0, 40.0]), np.array([41.3, 38.6])
    back = np.linalg.inv(affine)
    warped = 20 + 0.7 * cv2.warpAffine(
        frame, np.c_[back, center - back @ moved], (80, 80), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REFLECT
    )
    found = align(cut_patches(frame, np.ones_like(frame), center[None]), warped, center[None], np.eye(2)[None])
    assert np.allclose(found.xy[0], moved, atol=0.05) and np.allclose(found.affine[0], affine, atol=0.02)
    assert found.ncc[0] > 0.99 and found.sigma[0] < 0.1


def test_neighbours_predict_an_affine_motion_and_expose_a_stray() -> None:
    rng = np.random.default_rng(5)
    rest = rng.uniform(0, 100, (60, 2))
    affine = np.array([[1.1, 0.2], [-0.1, 0.9]])
    now = rest @ affine.T + [5.0, -3.0]
    true = now.copy()
    now[7] += [6.0, 0.0]
    predicted, found, support = predict(rest, now, np.ones(60, bool), np.tile(np.eye(2), (60, 1, 1)), 60.0)
    others = np.arange(60) != 7
    assert np.linalg.norm(predicted - true, axis=1).max() < 0.8
    assert np.abs(found - affine).max() < 0.06
    off = disagreement(now, predicted, support)
    assert off[7] > 5.0 and off[others].max() < 0.8


def test_small_fast_ball_is_followed_by_its_centroid(ball: Scene) -> None:
    told: list[dict] = []
    seen = observe(ball.path, ObserveSettings(box=ball.box, distance=1.0), Progress(told.append))
    assert seen.xy.shape[1] == 1 and seen.on_centroid.all() and seen.visible.all()
    assert np.linalg.norm(seen.xy[:, 0] - ball.centers, axis=1).max() < 0.3
    t = np.arange(len(ball.centers))
    acceleration = 2 * np.polyfit(t, seen.xy[:, 0], 2)[0]
    assert np.allclose(acceleration, [0.0, 1.2], atol=0.03)
    assert any("centroid" in message["message"] for message in told if message["type"] == "warning")


def test_ball_that_leaves_the_frame_becomes_invisible(tmp_path: Path) -> None:
    t = np.arange(12.0)
    scene = moving_body(tmp_path, np.stack([60 + 18 * t, 80 + 0 * t], axis=1), 0 * t, 6.0, None)
    told: list[dict] = []
    seen = observe(scene.path, ObserveSettings(box=scene.box, distance=1.0), Progress(told.append))
    inside = scene.centers[:, 0] < 205
    assert seen.visible[inside].all() and not seen.visible[scene.centers[:, 0] > 212].any()
    assert any("out of sight" in message["message"] for message in told if message["type"] == "warning")
    resumed, kills, _ = in_pieces(scene.path, ObserveSettings(box=scene.box, distance=1.0), tmp_path, 3)
    assert_same(resumed, seen)
    assert kills == 7


def test_given_tracks_replace_ours(disc: Scene, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    start = disc.centers[0] + rng.uniform(-20, 20, (9, 2))
    start[8] = [5.0, 5.0]
    xy = np.stack([disc.moved(start, t) for t in range(len(disc.frames))])
    visible = np.ones(xy.shape[:2], bool)
    visible[3, 2] = False
    xy[3, 2] = np.nan
    np.savez(tmp_path / "tracks.npz", xy=xy, visible=visible)
    seen = observe(disc.path, ObserveSettings(box=disc.box, distance=1.0, tracks=str(tmp_path / "tracks.npz")), NoProgress())
    assert seen.xy.shape == (13, 8, 2), "the track off the object is left out"
    assert np.array_equal(seen.visible, visible[:, :8]) and np.allclose(seen.xy[seen.visible], xy[:, :8][visible[:, :8]])
    assert np.isfinite(seen.xy).all() and np.allclose(seen.sigma, 0.3)
    part = observe(
        disc.path, ObserveSettings(box=(50, 30, 130, 120), distance=1.0, tracks=str(tmp_path / "tracks.npz"), frames=(2, 6)), NoProgress()
    )
    assert np.allclose(part.xy[0], xy[2, :8])
    np.savez(tmp_path / "tracks.npz", xy=xy[:, :1], visible=visible[:, :1])
    told: list[dict] = []
    observe(disc.path, ObserveSettings(box=disc.box, distance=1.0, tracks=str(tmp_path / "tracks.npz")), Progress(told.append))
    assert any("One track" in message["message"] for message in told if message["type"] == "warning")


def test_rows_of_tracks_beyond_the_clip_are_told(disc: Scene, tmp_path: Path) -> None:
    rows = np.tile(disc.centers[0], (15, 4, 1)) + np.random.default_rng(0).uniform(-9, 9, (4, 2))
    np.savez(tmp_path / "tracks.npz", xy=rows, visible=np.ones((15, 4), bool))
    for frames, tells in ((None, 1), ((0, 6), 0)):
        told: list[dict] = []
        settings = ObserveSettings(box=disc.box, distance=1.0, tracks=str(tmp_path / "tracks.npz"), frames=frames)
        observe(disc.path, settings, Progress(told.append))
        said = [one["message"] for one in told if one["type"] == "warning"]
        counted = sum("15 rows, the clip 13 frames: the last 2 are not used" in one for one in said)
        assert counted == tells, "rows after a chosen range may belong to the clip's other frames"


def test_tracks_beside_the_object_are_named_also_in_a_smaller_copy_of_the_clip(tmp_path: Path) -> None:
    frames = np.full((3, 90, 1600, 3), 90, np.uint8)
    for t, frame in enumerate(frames):
        frame[20:70, 100 + 9 * t : 400 + 9 * t] = 220
        cv2.imwrite(str(tmp_path / f"{t}.png"), frame)
    np.savez(tmp_path / "blender.npz", xy=np.full((3, 4, 2), [80.0, 10.0]), visible=np.ones((3, 4), bool))
    settings = ObserveSettings(box=(75.0, 5.0, 425.0, 85.0), distance=1.0, fps=25.0, tracks=str(tmp_path / "blender.npz"))
    with pytest.raises(UsageError, match="^No track of blender.npz is visible on the object in the first frame."):
        observe(tmp_path, settings, NoProgress())


def test_an_object_that_can_hardly_be_in_metres_is_told(disc: Scene) -> None:
    told: list[dict] = []
    observe(disc.path, ObserveSettings(box=disc.box, distance=1500.0, frames=(0, 2)), Progress(told.append))
    assert any("in metres?" in message["message"] for message in told if message["type"] == "warning")


@pytest.mark.parametrize("case", ["keys", "rows", "shape", "nan", "far", "sight", "sigma", "off", "text", "none"])
def test_track_files_refused(disc: Scene, tmp_path: Path, case: str) -> None:
    xy = np.tile(disc.centers[0], (13, 4, 1))
    values = {"xy": xy, "visible": np.ones((13, 4), bool), "sigma": np.full((13, 4), 0.2)}
    if case == "keys":
        del values["visible"]
    elif case == "rows":
        values = {key: value[:12] for key, value in values.items()}
    elif case == "shape":
        values["visible"] = np.ones((13, 3), bool)
    elif case == "nan":
        xy[9, 1] = np.nan
    elif case == "far":
        xy[9, 1] = 1e200
    elif case == "sight":
        values["visible"] = np.where(np.eye(13, 4) > 0, np.nan, 1.0)
    elif case == "sigma":
        values["sigma"][8, 0] = 0.0
    elif case == "off":
        xy[:] = np.array(disc.box[:2]) + 1.0  # a disc fills no corner of its box
    path = tmp_path / "tracks.npz"
    if case == "text":
        path.write_text("no arrays")
    elif case != "none":
        np.savez(path, **values)
    settings, begun = ObserveSettings(box=disc.box, distance=1.0, tracks=str(path), frames=(8, 12)), list[Steady]()
    with pytest.raises(UsageError) as caught:
        observe(disc.path, settings, NoProgress(), ready=begun.append)
    assert caught.value.hint
    assert bool(begun) == (case == "off")  # what needs no outline is told before there is one


@pytest.mark.parametrize(("count", "frames"), [(1, None), (8, None), (30, None), (1, (8, 12)), (8, (8, 12))])
def test_transposed_tracks_are_told_as_such(disc: Scene, tmp_path: Path, count: int, frames: tuple[int, int] | None) -> None:
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    start = disc.centers[0] + 20.0 * np.stack([np.cos(around), np.sin(around)], axis=1)
    xy = np.stack([disc.moved(start, t) for t in range(13)], axis=1)
    np.savez(tmp_path / "tracks.npz", xy=xy, visible=np.ones(xy.shape[:2], bool))
    with pytest.raises(UsageError, match=rf"look transposed: xy is \({count}, 13, 2\), with a row for each track") as caught:
        observe(disc.path, ObserveSettings(box=disc.box, distance=1.0, tracks=str(tmp_path / "tracks.npz"), frames=frames), NoProgress())
    assert "xy (T+1, K, 2)" in caught.value.hint and ("cut it to 13 rows" in caught.value.hint) == (count == 30)


def test_tracks_with_too_few_rows_are_not_called_transposed(disc: Scene, tmp_path: Path) -> None:
    np.savez(tmp_path / "tracks.npz", xy=np.tile(disc.centers[0], (9, 40, 1)), visible=np.ones((9, 40), bool))
    with pytest.raises(UsageError, match="have 9 rows, the clip 13 frames"):
        observe(disc.path, ObserveSettings(box=disc.box, distance=1.0, tracks=str(tmp_path / "tracks.npz")), NoProgress())


def test_a_confidence_is_not_taken_for_a_visibility(disc: Scene, tmp_path: Path) -> None:
    xy, settings = np.tile(disc.centers[0], (13, 4, 1)), ObserveSettings(box=disc.box, distance=1.0, tracks=str(tmp_path / "tracks.npz"))
    for value in (0.25, np.nan, 255):
        np.savez(tmp_path / "tracks.npz", xy=xy, visible=np.where(np.eye(13, 4) > 0, value, 1))
        with pytest.raises(UsageError, match=f"have {value:g} in `visible`") as caught:
            observe(disc.path, settings, NoProgress())
        assert "threshold" in caught.value.hint


@pytest.mark.parametrize(
    ("key", "value", "says"), [("xy", np.nan, "at [nan, nan] with sigma 0.2."), ("sigma", 0.0, "at [20.0, 20.0] with sigma 0.")]
)
def test_the_first_visible_point_without_a_place_is_named(tmp_path: Path, key: str, value: float, says: str) -> None:
    values = {"xy": np.full((13, 4, 2), 20.0), "visible": np.ones((13, 4), bool), "sigma": np.full((13, 4), 0.2)}
    values[key][5:, 3] = value
    np.savez(tmp_path / "tracks.npz", **values)
    with pytest.raises(UsageError) as caught:
        read_tracks(str(tmp_path / "tracks.npz"), 5, 4, np.ones((48, 64), bool), NoProgress())
    assert caught.value.message.endswith(f"track 3 is visible in row 5, {says}")


def test_cancel_is_heeded_at_every_frame(disc: Scene) -> None:
    asked = 0

    def cancelled() -> bool:
        nonlocal asked
        asked += 1
        return asked > 24

    before = cv2.getNumThreads()
    with pytest.raises(Cancelled):
        observe(disc.path, ObserveSettings(box=disc.box, distance=1.0), Progress(None, cancelled))
    assert asked == 25 and cv2.getNumThreads() == before


def test_progress_rises_and_names_frames(disc: Scene) -> None:
    told: list[dict] = []
    observe(disc.path, ObserveSettings(box=disc.box, distance=1.0, frames=(0, 5)), Progress(told.append))
    fractions = [message["fraction"] for message in told if message["type"] == "progress"]
    assert fractions == sorted(fractions) and fractions[-1] == 1.0
    assert sum("frame" in message["message"] for message in told) >= 5


def test_rendered_sheet(shared: Path) -> None:
    folder = shared / "truth" / "rendered" / "sheet_v0"
    settings = ObserveSettings(
        mask=str(folder / "mask_0000.png"), camera=str(folder / "camera.json"), depth=str(folder / "depth_0000.npy"), frames=(0, 8)
    )
    seen = observe(folder / "clip.mp4", settings, NoProgress())
    masks = np.load(folder / "masks.npz")["mask"][:9] > 0
    assert ((seen.masks & masks).sum(axis=(1, 2)) / (seen.masks | masks).sum(axis=(1, 2))).min() > 0.95
    truth = np.load(folder / "tracks_truth.npz")["xy"][:9]
    _, distinct = np.unique(truth[0].round(3), axis=0, return_index=True)
    known = np.stack([RBFInterpolator(truth[0, distinct], truth[t, distinct], neighbors=30)(seen.xy[0]) for t in range(9)])
    off = errors(seen, known)
    assert np.median(off) < 0.15 and np.percentile(off, 90) < 0.8
    assert seen.visible[-1].mean() > 0.75
    assert np.isfinite(seen.depth[seen.masks[0]]).all()


def test_real_ball_falls_with_g(shared: Path) -> None:
    """Free flight filmed before a hanging rule that the ball passes; 398.7 px/m and 30.19 frames a second."""
    clip = shared / "clips" / "ball_toss_osp" / "BallTossOut.mov"
    settings = ObserveSettings(frames=(12, 27), box=(168, 145, 188, 165), fps=30.19, pixels_per_metre=398.7)
    seen = observe(clip, settings, NoProgress())
    assert seen.on_centroid.all()
    points = seen.camera.unproject(seen.xy[:, 0], np.full(len(seen.xy), seen.camera.fx / 398.7))
    t = np.arange(len(points)) / seen.fps
    use = seen.visible[:, 0]
    assert use.mean() > 0.9
    acceleration = 2 * np.polyfit(t[use], points[use], 2)[0]
    assert np.linalg.norm(acceleration) == pytest.approx(9.8, rel=0.05)
    assert np.degrees(np.arccos(-acceleration[2] / np.linalg.norm(acceleration))) < 5.0


def test_a_pattern_that_fades_hands_over_to_the_silhouette(tmp_path: Path) -> None:
    t = np.arange(16)
    pattern = noise(np.random.default_rng(4), (160, 220), (60, 20, 10), (250, 160, 90), 1.6)

    def body(frame: int, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
        own = np.roll(pattern, (5 * frame, 4 * frame), (0, 1))
        return own if frame < 11 else np.broadcast_to(pattern.mean(axis=(0, 1)), own.shape)

    scene = painted_scene(tmp_path, np.stack([60 + 4.0 * t, 60 + 2.0 * t], axis=1), 0.0 * t, 34.0, body)
    told: list[dict] = []
    seen = observe(scene.path, ObserveSettings(box=scene.box, distance=1.0), Progress(told.append))
    assert any("Too few points" in message["message"] for message in told if message["type"] == "warning")
    assert not seen.on_centroid[:-1].any() and seen.on_centroid[-1]
    assert seen.visible[12:, -1].all() and not seen.visible[:8, -1].any()
    assert np.linalg.norm(seen.xy[12:, -1] - scene.centers[12:], axis=1).max() < 4.0


@pytest.mark.parametrize(("glitter", "on_centroid"), [(0.3, False), (0.6, True)])
def test_corners_that_only_flicker_give_way_to_the_silhouette(tmp_path: Path, glitter: float, on_centroid: bool) -> None:
    """A part `glitter` of the body looks anew in every frame; enough corners are followed in each, but of the larger part none for long."""
    t = np.arange(24)
    rng = np.random.default_rng(6)

    def pattern() -> np.ndarray:
        return noise(rng, (160, 220), (60, 20, 10), (250, 160, 90), 1.6)

    own, flashes = pattern(), [pattern() for _ in t]
    clouds = [cv2.GaussianBlur(rng.standard_normal((160, 220)), (0, 0), 4.0) for _ in t]

    def body(frame: int, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
        flashing = (clouds[frame] > np.quantile(clouds[frame], 1.0 - glitter)) & (frame > 0)
        return np.where(flashing[..., None], flashes[frame], np.roll(own, (2 * frame, 4 * frame), (0, 1)))

    scene = painted_scene(tmp_path, np.stack([60 + 4.0 * t, 60 + 2.0 * t], axis=1), 0.0 * t, 34.0, body)
    seen = observe(scene.path, ObserveSettings(box=scene.box, distance=1.0), NoProgress())
    assert seen.on_centroid.all() == on_centroid
    first = seen.visible[0]
    moved = np.where(seen.visible[:, first, None], seen.xy[:, first] - seen.xy[:1, first], np.nan)
    off = np.linalg.norm(np.nanmean(moved, axis=1) - (scene.centers - scene.centers[0]), axis=1)
    assert off.max() < (1.5 if on_centroid else 0.6)


def test_corners_that_folds_hide_for_a_while_do_not_flicker() -> None:
    """Waves pass over a flag and hide each corner for 10 frames of 18, which is less of the time than flicker leaves one out of sight."""
    frame, corner = np.arange(60)[:, None], np.arange(90)[None]
    folded = (frame + corner) % 18 >= 10
    flickering = np.random.default_rng(6).random((60, 90)) > 10 / 18
    assert folded[:30].mean() < 0.5 and flickering[:30].mean() < 0.5
    assert flickers(flickering, 30)
    assert not flickers(folded, 30)
