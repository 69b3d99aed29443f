"""The object in picture 0, and its mask through the clip."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scenes import HEIGHT, WIDTH, Scene

from seeing_wind.engine.errors import ObjectError, UsageError
from seeing_wind.engine.observe import observe
from seeing_wind.engine.observe.mask import read_mask
from seeing_wind.engine.progress import NoProgress, Progress
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import ObserveSettings


def overlap(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    return (found & true).sum(axis=(1, 2)) / (found | true).sum(axis=(1, 2))


def test_box_follows_the_silhouette(disc: Scene, disc_seen: Observation) -> None:
    iou = overlap(disc_seen.masks, disc.masks)
    assert iou[0] > 0.95 and iou.min() > 0.93


def test_loose_box(disc: Scene) -> None:
    x0, y0, x1, y1 = disc.box
    seen = observe(disc.path, ObserveSettings(box=(x0 - 9.5, y0 - 8.2, x1 + 8, y1 + 9), distance=1.0), NoProgress())
    assert overlap(seen.masks, disc.masks).min() > 0.9


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
    """The background of the scene: the mean of the pictures off the object."""
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
    (tmp_path / "text.png").write_text("no picture")
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
