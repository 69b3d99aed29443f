"""What the clip's camera does to all that it sees is measured, and done to the render."""

from __future__ import annotations

from pathlib import Path

import bpy
import cv2
import numpy as np
import pytest

from seeing_wind.engine.masks import Masks
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.take import Take
from seeing_wind.ui.composite import composite
from seeing_wind.ui.composite.film import grain_of, softness_of
from seeing_wind.ui.composite.film.softness import softness
from tests.ui.composite.rendering import red_cube, render


def test_the_clips_grain_is_measured_and_put_on_what_is_not_the_clip(scene, tmp_path):
    """Gaussian noise of 3 % on a frame with a slope: found to a tenth, and again on the plate of the render."""
    take = Take(Path(scene.seeing_wind.recovered_take))
    arrays = take.read_arrays("observation.npz")
    rng = np.random.default_rng(3)
    slope = np.linspace(60.0, 160.0, 96)[None, :, None] + np.zeros((64, 96, 3))
    arrays["image"] = np.clip(slope + 255.0 * 0.03 * rng.normal(size=slope.shape), 0, 255).astype(np.uint8)
    take.write_arrays("observation.npz", arrays)
    assert grain_of(take) == pytest.approx(0.03, rel=0.1)
    scene.frame_set(3)
    said = composite.set_up(scene, plate="PLATE", samples=1)
    assert said.behind == "moving plate" and said.grain == grain_of(take)
    covered = render(tmp_path / "grain.png")[24:40, 28:44, 1] / 255.0
    assert covered.std() == pytest.approx(0.03, rel=0.25) and abs(covered.mean() - 120 / 255) < 0.01
    scene.frame_set(4)
    again = render(tmp_path / "later.png")[24:40, 30:44, 1] / 255.0
    assert abs(np.corrcoef(covered[:, 2:].ravel(), again.ravel())[0, 1]) < 0.3, "grain that stands still is dirt on the lens"
    composite.set_up(scene, plate="PLATE", samples=1, grain=0.0)
    assert render(tmp_path / "clean.png")[24:40, 30:44, 1].std() < 1.5


@pytest.mark.parametrize("blur", [0.4, pytest.param(0.9, marks=pytest.mark.slow), 1.6])
def test_the_clips_softness_is_measured_at_the_rim_and_given_to_the_render(scene, tmp_path, blur):
    """A dark square, turned so that its rim falls between the pixels: found to a tenth, and again on a cube that is rendered."""
    fine, finer = 8, 64 * 8
    rows, columns = np.mgrid[:finer, : 96 * fine] / fine - np.array([32.0, 48.0])[:, None, None]
    inside = np.maximum(np.abs(rows * 0.96 + columns * 0.28), np.abs(columns * 0.96 - rows * 0.28)) < 18.0
    blurred = cv2.GaussianBlur(np.where(inside, 0.08, 0.35), (0, 0), blur * fine)[fine // 2 :: fine, fine // 2 :: fine]
    frame = np.round(255.0 * (1.055 * blurred ** (1 / 2.4) - 0.055)).astype(np.uint8)[..., None].repeat(3, axis=2)
    mask = inside[fine // 2 :: fine, fine // 2 :: fine]
    found = softness(frame, mask)
    assert found == pytest.approx(blur, rel=0.1, abs=0.06)
    assert softness(frame * 0 + 99, mask) == 0.0, "nothing is seen of a rim"
    take = Take(Path(scene.seeing_wind.recovered_take))
    arrays = take.read_arrays("observation.npz")
    count = len(from_arrays(Masks, arrays, "masks."))
    take.write_arrays("observation.npz", arrays | {"image": frame} | to_arrays(Masks.of([mask] * count), "masks."))
    assert softness_of(take) == found
    red_cube(scene)
    cube = bpy.context.object
    cube.location, cube.scale, cube.rotation_euler = (0.0, -0.3, 0.0), (1.6, 1.6, 1.6), (0.0, 0.3, 0.0)
    seen = {}
    for factor in (1.0, 0.0):
        said = composite.set_up(scene, plate="PLATE", samples=64, shutter=0.0, grain=0.0, soft=factor)
        assert said.softness == pytest.approx(found * factor)
        rendered = render(tmp_path / "soft.png", denoised=True).astype(np.uint8)
        seen[factor] = softness(rendered, rendered[..., 0].astype(int) - rendered[..., 1] > 100)
    assert seen[1.0] == pytest.approx(found, rel=0.2, abs=0.15) and seen[0.0] < 0.3
