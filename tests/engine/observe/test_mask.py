"""The object in frame 0, and its mask through the clip."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import HEIGHT, WIDTH, Scene, moving_body, noise, overlap, painted_scene
from scipy import ndimage

from seeing_wind.engine.command.arguments import parser
from seeing_wind.engine.errors import ObjectError, UsageError
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.mask.background import median_plate, plate_with_first
from seeing_wind.engine.observe.mask.cutting import HOLE, SPECK, enclosed, tidy
from seeing_wind.engine.observe.mask.first_mask import mask_from_points, read_mask
from seeing_wind.engine.observe.mask.motion import median_of
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import ObserveSettings


def test_box_follows_the_silhouette(disc: Scene, disc_seen: Observation) -> None:
    iou = overlap(disc_seen.masks, disc.masks)
    assert iou[0] > 0.95 and iou.min() > 0.93


@pytest.mark.parametrize("count", [2, 3, 8, 31])
def test_the_background_is_the_lower_median(count: int) -> None:
    frames = np.random.default_rng(count).integers(0, 256, (count, 40, 30, 3)).astype(np.uint8)
    plate = median_plate(frames, NoProgress())
    assert np.array_equal(plate.color, np.sort(frames, axis=0)[(count - 1) // 2])
    away = np.abs(frames.astype(int) - plate.color)
    if count > 2:  # of two, the lower difference is none; more are nothing but grain, which is averaged out first
        smooth, middle = np.stack([cv2.GaussianBlur(one, (0, 0), 0.8) for one in frames]), cv2.GaussianBlur(plate.color, (0, 0), 0.8)
        away = np.abs(smooth.astype(int) - middle)
    assert np.array_equal(plate.reliable, (np.sort(away, axis=0)[(count - 1) // 2] <= 5).all(axis=2))


def test_loose_box(disc: Scene) -> None:
    x0, y0, x1, y1 = disc.box
    seen = observe(disc.path, ObserveSettings(box=(x0 - 9.5, y0 - 8.2, x1 + 8, y1 + 9), distance=1.0), NoProgress())
    assert overlap(seen.masks, disc.masks).min() > 0.9


def test_a_highlight_like_the_background_is_not_lost(tmp_path: Path) -> None:
    """A red ball pales from above to about the paper's colour while it swings."""
    t = np.arange(28)
    red, pale = np.array([150.0, 30.0, 25.0]), np.array([165.0, 140.0, 118.0])

    def body(frame: int, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
        share = 1.0 / (1.0 + np.exp((dy + 22.0 - 2.0 * min(frame, 11)) / 3.0))[..., None]
        return (1.0 - share) * red + share * pale

    scene = painted_scene(tmp_path, np.stack([40 + 5.0 * t, 70 + 10 * np.sin(0.4 * t)], axis=1), 0.0 * t, 26.0, body)
    cv2.imwrite(str(tmp_path / "mask.png"), scene.masks[0].astype(np.uint8))
    seen = observe(scene.path, ObserveSettings(mask=str(tmp_path / "mask.png"), distance=1.0), NoProgress())
    assert overlap(seen.masks, scene.masks).min() > 0.8
    assert np.abs(np.stack([np.argwhere(mask).mean(axis=0)[::-1] for mask in seen.masks]) - scene.centers).max() < 3.0


def test_points_on_what_moves(disc: Scene) -> None:
    middle = disc.centers[0]
    seen = observe(disc.path, ObserveSettings(points=(middle[0], middle[1]), distance=1.0), NoProgress())
    assert overlap(seen.masks, disc.masks).min() > 0.93


def test_points_where_no_background_is_known(disc: Scene) -> None:
    ring = disc.centers[0] + 18.0 * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    found = mask_from_points(disc.frames[0], ring, None, NoProgress())
    assert overlap(found[None], disc.masks[:1])[0] > 0.85
    aside = mask_from_points(disc.frames[0], ring[:3], None, NoProgress())
    assert (aside & ~disc.masks[0]).sum() < 0.1 * disc.masks[0].sum(), "it stays with what the points lie on"


def test_points_by_the_command_line(disc: Scene, tmp_path: Path) -> None:
    words = ["recover", str(disc.path), "--take", str(tmp_path / "a.take")]
    assert parser().parse_args([*words, "--points", "12,30.5", "40,31"]).points == [(12.0, 30.5), (40.0, 31.0)]
    for wrong in (["--points", "12"], ["--points", "a,b"], ["--points", "1,2", "--box", "0", "0", "9", "9"]):
        with pytest.raises(UsageError):
            parser().parse_args([*words, *wrong])


@pytest.mark.parametrize("points", [(), (3.0,), (4.0, 500.0), (np.nan, 3.0)])
def test_points_refused(disc: Scene, points: tuple[float, ...]) -> None:
    with pytest.raises(UsageError) as caught:
        observe(disc.path, ObserveSettings(points=points, distance=1.0, frames=(0, 3)), NoProgress())
    assert caught.value.hint


def test_points_on_the_background_are_told(disc: Scene) -> None:
    with pytest.raises(ObjectError) as caught:
        observe(disc.path, ObserveSettings(points=(200.0, 20.0), distance=1.0, frames=(0, 3)), NoProgress())
    assert "--box" in caught.value.hint


def test_mask_file_is_taken_as_it_is(disc: Scene, tmp_path: Path) -> None:
    path = tmp_path / "mask.png"
    cv2.imwrite(str(path), disc.masks[0].astype(np.uint8))
    seen = observe(disc.path, ObserveSettings(mask=str(path), distance=1.0, frames=(0, 4)), NoProgress())
    assert np.array_equal(seen.masks[0], disc.masks[0])
    assert overlap(seen.masks, disc.masks[:5]).min() > 0.93


def test_transparent_pixels_are_outside(tmp_path: Path) -> None:
    values = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    values[10:20, 10:20] = 255
    values[15:20, 10:20, 3] = 0
    cv2.imwrite(str(tmp_path / "mask.png"), values)
    assert read_mask(str(tmp_path / "mask.png"), HEIGHT, WIDTH).sum() == 50


def test_what_moves_is_found_without_a_box(ball: Scene) -> None:
    told: list[dict] = []
    seen = observe(ball.path, ObserveSettings(distance=1.0), Progress(told.append))
    assert overlap(seen.masks[:1], ball.masks[:1])[0] > 0.6
    assert any("Neither mask nor box" in message["message"] for message in told if message["type"] == "warning")


def test_background_is_clean(disc: Scene, disc_seen: Observation) -> None:
    ever = disc.masks.any(axis=0)
    away = np.abs(disc_seen.background.astype(int) - _behind(disc)).max(axis=2)
    assert np.median(away[ever & ~disc.masks.all(axis=0)]) < 9
    assert away[~ever].mean() < 5


def _behind(disc: Scene) -> np.ndarray:
    """The background of the scene: the mean of the frames off the object."""
    off = ~disc.masks[..., None]
    return (disc.frames * off).sum(axis=0) / np.maximum(off.sum(axis=0), 1)


@pytest.mark.parametrize(
    "box", [(400.0, 400.0, 500.0, 500.0), (50.0, 50.0, 50.0, 90.0), (90.0, 60.0, 50.0, 90.0), (0.0, 0.0, WIDTH, HEIGHT)]
)
def test_boxes_refused(disc: Scene, box: tuple[float, float, float, float]) -> None:
    with pytest.raises(UsageError) as caught:
        observe(disc.path, ObserveSettings(box=box, distance=1.0), NoProgress())
    assert caught.value.hint


def test_masks_refused(disc: Scene, tmp_path: Path) -> None:
    cases = {
        "nothing": np.zeros((HEIGHT, WIDTH), np.uint8),
        "speck": np.zeros((HEIGHT, WIDTH), np.uint8),
        "all": np.ones((HEIGHT, WIDTH), np.uint8),
    }
    cases["speck"][50, 50:53] = 255
    for name, values in cases.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), values)
        with pytest.raises(ObjectError) as caught:
            observe(disc.path, ObserveSettings(mask=str(tmp_path / f"{name}.png"), distance=1.0), NoProgress())
        assert caught.value.hint
    cv2.imwrite(str(tmp_path / "size.png"), np.ones((20, 20), np.uint8))
    (tmp_path / "text.png").write_text("no frame")
    for name in ("size", "text", "none"):
        with pytest.raises(UsageError):
            observe(disc.path, ObserveSettings(mask=str(tmp_path / f"{name}.png"), distance=1.0), NoProgress())


def test_nothing_moves_and_nothing_marked(disc: Scene, tmp_path: Path) -> None:
    for index in range(4):
        cv2.imwrite(str(tmp_path / f"{index}.png"), disc.frames[0])
    with pytest.raises(ObjectError) as caught:
        observe(tmp_path, ObserveSettings(fps=25.0, distance=1.0), NoProgress())
    assert "--box" in caught.value.hint


def test_pin(disc: Scene, tmp_path: Path) -> None:
    pin = np.zeros((HEIGHT, WIDTH), np.uint8)
    pin[: int(disc.centers[0, 1])] = 255
    cv2.imwrite(str(tmp_path / "pin.png"), pin)
    seen = observe(disc.path, ObserveSettings(box=disc.box, pin=str(tmp_path / "pin.png"), distance=1.0, frames=(0, 2)), NoProgress())
    assert seen.pin.any() and not (seen.pin & ~seen.masks[0]).any() and not (seen.pin & (pin == 0)).any()
    cv2.imwrite(str(tmp_path / "off.png"), np.roll(pin, 100, axis=0) * 0)
    with pytest.raises(ObjectError, match="pinned"):
        observe(disc.path, ObserveSettings(box=disc.box, pin=str(tmp_path / "off.png"), distance=1.0, frames=(0, 2)), NoProgress())


def test_background_is_known_where_the_object_comes_to_turn(tmp_path: Path) -> None:
    """Half of the clip it turns in one place, which it left free at first: the median there is neither it nor the background."""
    t = np.arange(15.0)
    texture = noise(np.random.default_rng(2), (90, 90), (120, 40, 20), (255, 200, 110), 1.6)
    scene = moving_body(tmp_path, np.stack([np.minimum(50 + 20 * t, 150), 80 + 0 * t], axis=1), 0.4 * t, 30.0, texture)
    plate = median_plate(scene.frames, NoProgress())
    place = scene.masks[-1] & ~scene.masks[0]
    assert plate.reliable[place].mean() < 0.5
    better = plate_with_first(plate, scene.frames, scene.masks[0], scene.masks[0])
    assert better.reliable[place].mean() > 0.95 and not (plate.reliable & ~better.reliable).any()
    assert np.abs(better.color[place].astype(int) - scene.frames[0][place]).mean() < 3
    seen = observe(scene.path, ObserveSettings(box=scene.box, distance=1.0), NoProgress())
    assert overlap(seen.masks, scene.masks).min() > 0.9


def test_a_body_may_hide_what_it_encloses_and_a_stem_with_leaves_may_not() -> None:
    bent = np.zeros((120, 120), bool)
    bent[10:110, 10:40] = bent[10:40, 10:110] = True  # fills half of its hull
    assert enclosed(bent)[55, 55] and not enclosed(bent)[100, 100] and enclosed(bent)[bent].all()
    flower = np.zeros((120, 120), bool)
    flower[5:115, 59:62] = flower[5:20, 45:76] = flower[80:84, 10:110] = True
    assert np.array_equal(enclosed(flower), flower)
    assert not enclosed(np.zeros((4, 4), bool)).any()


def tidied(mask: np.ndarray, near: np.ndarray | None) -> np.ndarray:
    """As `tidy`, by the figures that SciPy has of each part."""
    labels, count = ndimage.label(mask, np.ones((3, 3)))
    parts = [labels == one for one in range(1, count + 1)]
    areas = np.array([part.sum() for part in parts])
    keep = areas >= 0.1 * areas.max()
    if near is not None:
        keep = np.array([(part & near).any() for part in parts])
        if count > 1:
            keep &= areas >= SPECK * max(areas[keep], default=0)
    whole = np.any([part for part, kept in zip(parts, keep) if kept] or [np.zeros_like(mask)], axis=0)
    holes, count = ndimage.label(~whole)
    small = [holes == one for one in range(1, count + 1) if (holes == one).sum() < HOLE * whole.sum()]
    return np.any([whole, *small], axis=0)


@pytest.mark.parametrize("sigma", [1.0, 2.5, 6.0])
def test_specks_and_small_holes_go(sigma: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        mask = cv2.GaussianBlur(rng.normal(size=(60, 50)), (0, 0), sigma) > rng.normal(0.0, 0.1) / sigma
        near = np.zeros_like(mask)
        near[20:40, 10:30] = True
        assert np.array_equal(tidy(mask), tidied(mask, None))
        assert np.array_equal(tidy(mask, near), tidied(mask, near))
    ring = cv2.circle(cv2.circle(np.zeros((60, 60), np.uint8), (30, 30), 20, 1, -1), (30, 30), 3, 0, -1) > 0
    assert not ring[30, 30] and tidy(ring)[30, 30]


@pytest.mark.parametrize("count", [1, 2, 3, 8, 501, 502])
def test_median(count: int) -> None:
    values = np.random.default_rng(count).normal(size=count).astype(np.float32)
    assert median_of(values) == float(np.median(values))
