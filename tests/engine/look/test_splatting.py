"""The rasteriser: against a plain one, in value and gradient, and its fit."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.field.torch_threads import one_torch_thread
from seeing_wind.engine.look.first_frame import View, fit
from seeing_wind.engine.look.gaussians import pixel_aligned, rest_covariances, view_camera
from seeing_wind.engine.look.splatting import PIXEL_FILTER, blend, project, render_gaussians, tiles_of
from seeing_wind.engine.observe.object.shape.particles import fill
from seeing_wind.engine.observe.object.shape.relief import relief_of
from seeing_wind.engine.progress import Cancelled, NoProgress, Progress
from seeing_wind.engine.records import Camera

from .test_gaussians_ply import some


def small_camera() -> Camera:
    return Camera(20, 13, 20.0, 20.0, 9.5, 6.0, front_view(4.0))


def plain(gaussians, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Every Gaussian at every pixel, sorted by depth, one after the other."""
    mean, depth = camera.project(gaussians.x)
    jacobian = camera.projection_jacobian(gaussians.x)
    flat = jacobian @ rest_covariances(gaussians) @ jacobian.transpose(0, 2, 1) + PIXEL_FILTER * np.eye(2)
    rows, columns = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([columns, rows], axis=-1)
    image, passed = np.zeros((camera.height, camera.width, 3)), np.ones((camera.height, camera.width))
    for g in np.argsort(depth):
        offset = pixels - mean[g]
        power = -0.5 * np.einsum("hwa,ab,hwb->hw", offset, np.linalg.inv(flat[g]), offset)
        alpha = np.minimum(gaussians.opacity[g] * np.exp(power), 0.99)
        image += (passed * alpha)[..., None] * np.clip(0.5 + 0.28209479177387814 * gaussians.sh[g, 0], 0.0, 1.0)
        passed *= 1.0 - alpha
    return image, 1.0 - passed


def test_frame_equals_the_plain_rasteriser(monkeypatch) -> None:
    monkeypatch.setattr("seeing_wind.engine.look.splatting.CUTOFF", 6.0)
    gaussians, camera = some(9), small_camera()
    image, alpha = render_gaussians(gaussians, camera)
    expected, cover = plain(gaussians, camera)
    assert cover.max() > 0.5
    assert image == pytest.approx(expected, abs=2e-5)
    assert alpha == pytest.approx(cover, abs=2e-5)


def test_gradients_against_finite_differences() -> None:
    gaussians, camera = some(3), Camera(9, 8, 12.0, 12.0, 4.0, 3.5, front_view(4.0))
    x = torch.tensor(gaussians.x, requires_grad=True)
    root = torch.tensor(np.linalg.cholesky(rest_covariances(gaussians)), requires_grad=True)
    opacity = torch.tensor(gaussians.opacity, requires_grad=True)
    colour = torch.rand(3, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0), requires_grad=True)
    with torch.no_grad():
        mean, flat, depth = project(x, root @ root.transpose(1, 2), camera)
    tiles = tiles_of(mean, 9.0 * flat, depth, camera.width, camera.height)  # wide: no Gaussian leaves its list

    def render(x, root, opacity, colour):
        mean, flat, _ = project(x, root @ root.transpose(1, 2), camera)
        return blend(mean, flat, opacity, colour, tiles, camera.width, camera.height)

    with one_torch_thread():
        assert torch.autograd.gradcheck(render, (x, root, opacity, colour), eps=1e-6, atol=1e-6)


def test_frame_moves_with_the_particles() -> None:
    gaussians, camera = some(6), small_camera()
    shift = np.array([0.0, 0.0, 4.0 / 20.0])  # up by about one pixel at the distance of 4 m
    still, moved = (render_gaussians(gaussians, camera, x=x)[1] for x in (gaussians.x, gaussians.x + shift))
    rows = np.arange(camera.height)[:, None]
    assert (still * rows).sum() / still.sum() - (moved * rows).sum() / moved.sum() == pytest.approx(1.0, abs=0.3)


def test_behind_the_camera_nothing_is_drawn() -> None:
    gaussians = some(4)
    gaussians.x[:, 1] = -9.0
    assert render_gaussians(gaussians, small_camera())[1].max() == 0.0


def test_reduced_camera_sees_the_same_points() -> None:
    camera = Camera(64, 48, 60.0, 61.0, 31.5, 23.5, np.eye(4))
    view = view_camera(camera, (8, 4, 56, 44), 2)
    points = np.array([[0.1, -0.05, 1.0], [-0.2, 0.1, 1.5]])
    whole, _ = camera.project(points)
    assert view.project(points)[0] == pytest.approx((whole - [8, 4] + 0.5) / 2 - 0.5)
    assert (view.width, view.height) == (24, 20)


def test_fit_reaches_the_frame(plate) -> None:
    relief = relief_of(plate)
    start = pixel_aligned(relief, plate.image, fill(relief, 100).x, count=300)
    view = View(relief.camera, relief.mask, plate.image, np.zeros_like(plate.image))
    _, before = fit(start, [view], NoProgress(), iterations=0)
    fitted, after = fit(start, [view], NoProgress())
    assert after > 30.0
    assert after > before + 4.0
    assert ((fitted.opacity > 0.0) & (fitted.opacity < 1.0)).all() and (fitted.scale > 0.0).all()
    image, alpha = render_gaussians(fitted, plate.camera)
    inside = relief.mask
    error = ((image - plate.image / 255.0) ** 2)[inside].mean()
    assert -10.0 * np.log10(error) == pytest.approx(after, abs=1.0)
    assert alpha[inside].mean() > 0.9 and alpha[~inside].mean() < 0.02


def test_fit_can_be_cancelled(plate) -> None:
    relief = relief_of(plate)
    start = pixel_aligned(relief, plate.image, fill(relief, 50).x, count=60)
    view = View(relief.camera, relief.mask, plate.image, np.zeros_like(plate.image))
    asked = []
    threads = torch.get_num_threads()
    with pytest.raises(Cancelled):
        fit(start, [view], Progress(cancelled=lambda: len(asked) > 2 or bool(asked.append(1))))
    assert len(asked) == 3
    assert torch.get_num_threads() == threads
