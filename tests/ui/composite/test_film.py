"""What the clip's camera does to all that it sees is measured, and done to the render."""

from __future__ import annotations

from pathlib import Path

import bpy
import cv2
import numpy as np
import pytest

from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.masks import Masks
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.take import Take
from seeing_wind.ui.clip.inputs.pace import Pace
from seeing_wind.ui.composite import composite
from seeing_wind.ui.composite.film import grain_of, keep_focus, set_focus, softness_of
from seeing_wind.ui.composite.film.focus import FOCUS
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


def test_what_is_farther_than_the_object_is_out_of_focus(scene, tmp_path) -> None:
    """A white edge at the object's distance and one five times as far: how many columns lie between dark and bright."""
    for name, x, y, size in (("Near", -0.3, 0.0, 0.3), ("Far", 2.0, 8.0, 1.5)):
        bpy.ops.mesh.primitive_plane_add(size=size, location=(x, y, 0.0), rotation=(0.5 * np.pi, 0.0, 0.0))
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        material.node_tree.nodes["Principled BSDF"].inputs["Emission Color"].default_value = (1.0, 1.0, 1.0, 1.0)
        material.node_tree.nodes["Principled BSDF"].inputs["Emission Strength"].default_value = 1.0
        bpy.context.object.data.materials.append(material)

    def widths() -> tuple[int, int]:
        row = render(tmp_path / "focus.png")[31].mean(axis=-1)
        return tuple(int(((part > 75.0) & (part < 215.0)).sum()) for part in (row[:48], row[60:]))

    composite.set_up(scene, plate="PLATE", samples=64, shutter=0.0, grain=0.0, soft=0.0)
    near, far = widths()
    said = composite.set_up(scene, plate="PLATE", samples=64, shutter=0.0, grain=0.0, soft=0.0, fstop=0.2)
    assert "f/0.2" in str(said) and widths()[0] <= near + 1 and widths()[1] >= far + 4
    composite.set_up(scene, plate="PLATE", samples=64, shutter=0.0, grain=0.0, soft=0.0)
    assert widths() == (near, far) and FOCUS not in scene.objects and not scene.camera.data.dof.use_dof


def test_the_focus_follows_the_object_and_its_pace(scene) -> None:
    depths = np.linspace(2.0, 3.0, 13)
    set_focus(scene, depths, 2.0, Pace(1))
    focus, camera = scene.objects[FOCUS], scene.camera
    keep_focus(scene, Pace(101, 2.0))
    for frame, depth in ((101, 2.0), (113, 2.5), (125, 3.0)):
        scene.frame_set(frame)
        bpy.context.view_layer.update()
        assert (camera.matrix_world.inverted() @ focus.matrix_world.translation).z == pytest.approx(-depth, abs=1e-5)
    with pytest.raises(UsageError, match="no object to focus on"):
        set_focus(scene, None, 2.0, Pace(1))
