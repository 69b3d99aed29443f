"""Gaussians at rest, deformed, and on disk."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from seeing_wind.engine.look import write_ply
from seeing_wind.engine.look.gaussians import SH0, covariances, pixel_aligned, rest_covariances
from seeing_wind.engine.observe.object.shape.particles import fill
from seeing_wind.engine.observe.object.shape.relief import relief_of
from seeing_wind.engine.records import Attachment, Gaussians


def self_attached(count: int) -> Attachment:
    """Every Gaussian carries itself."""
    return Attachment(index=np.arange(count, dtype=np.int32)[:, None], weight=np.ones((count, 1)))


def colours(gaussians: Gaussians) -> np.ndarray:
    """(G, 3) RGB in 0..1 of the degree-0 harmonics."""
    return np.clip(0.5 + SH0 * gaussians.sh[:, 0], 0.0, 1.0)


def some(count: int = 7, bands: int = 1) -> Gaussians:
    rng = np.random.default_rng(0)
    return Gaussians(
        x=rng.normal(size=(count, 3)),
        scale=rng.uniform(0.01, 0.1, size=(count, 3)),
        rotation=Rotation.random(count, random_state=0).as_quat()[:, [3, 0, 1, 2]],
        opacity=rng.uniform(0.1, 0.9, count),
        sh=rng.normal(size=(count, bands, 3)),
        attachment=self_attached(count),
    )


@pytest.mark.parametrize("bands", [1, 4])
def test_ply_holds_the_gaussians_as_other_viewers_read_them(tmp_path, bands: int) -> None:
    before = some(bands=bands)
    write_ply(tmp_path / "g.ply", before)
    head, _, body = (tmp_path / "g.ply").read_bytes().partition(b"end_header\n")
    names = [line.split()[2] for line in head.decode().splitlines() if line.startswith("property float")]
    columns = dict(zip(names, np.frombuffer(body, "<f4").reshape(-1, len(names)).T, strict=True))

    def found(wanted: str) -> np.ndarray:
        return np.stack([columns[name] for name in wanted.split()], axis=1)

    assert found("x y z") == pytest.approx(before.x, rel=1e-5)
    assert np.exp(found("scale_0 scale_1 scale_2")) == pytest.approx(before.scale, rel=1e-5)
    assert found("rot_0 rot_1 rot_2 rot_3") == pytest.approx(before.rotation, rel=1e-5, abs=1e-6)
    assert 1.0 / (1.0 + np.exp(-columns["opacity"])) == pytest.approx(before.opacity, rel=1e-5)
    assert found("f_dc_0 f_dc_1 f_dc_2") == pytest.approx(before.sh[:, 0], rel=1e-5)
    for number in range(3 * (bands - 1)):  # colour channel by colour channel
        channel, band = divmod(number, bands - 1)
        assert columns[f"f_rest_{number}"] == pytest.approx(before.sh[:, 1 + band, channel], rel=1e-5)


def test_ply_header_is_the_standard_one(tmp_path) -> None:
    write_ply(tmp_path / "g.ply", some(3))
    head, _, body = (tmp_path / "g.ply").read_bytes().partition(b"end_header\n")
    names = [line.split()[2] for line in head.decode().splitlines() if line.startswith("property")]
    expected = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3"
    assert names == expected.split()
    assert b"format binary_little_endian 1.0" in head and b"element vertex 3" in head
    rows = np.frombuffer(body, "<f4").reshape(3, 17)
    first = some(3)
    assert rows[:, 9] == pytest.approx(np.log(first.opacity / (1 - first.opacity)), rel=1e-5)
    assert rows[:, 10:13] == pytest.approx(np.log(first.scale), rel=1e-5)


def test_opaque_gaussians_are_written_finite(tmp_path) -> None:
    solid = dataclasses.replace(some(2), opacity=np.array([0.0, 1.0]))
    write_ply(tmp_path / "g.ply", solid)
    assert np.isfinite(np.frombuffer((tmp_path / "g.ply").read_bytes().partition(b"end_header\n")[2], "<f4")).all()


def test_covariances_follow_the_deformation_gradient() -> None:
    gaussians = some()
    rest = rest_covariances(gaussians)
    assert np.sqrt(np.linalg.eigvalsh(rest)) == pytest.approx(np.sort(gaussians.scale, axis=1))
    F = np.eye(3) + 0.3 * np.random.default_rng(1).normal(size=(7, 3, 3))
    assert covariances(gaussians, F) == pytest.approx(np.stack([f @ s @ f.T for f, s in zip(F, rest)]))
    assert covariances(gaussians, np.broadcast_to(np.eye(3), (7, 3, 3))) == pytest.approx(rest)


def test_pixel_aligned_gaussians_lie_flat_on_the_surface(plate) -> None:
    relief = relief_of(plate)
    gaussians = pixel_aligned(relief, plate.image, fill(relief, 200).x)
    assert len(gaussians.x) == plate.masks[0].sum()  # one per pixel of a small object
    assert np.linalg.norm(gaussians.rotation, axis=1) == pytest.approx(np.ones(len(gaussians.x)))
    axes = Rotation.from_quat(gaussians.rotation[:, [1, 2, 3, 0]]).as_matrix()
    # The plane z = 1 + 0.5 x of the camera; its normal towards the camera is (0.5, 0, -1) there.
    normal = plate.camera.pose(0)[:3, :3] @ (np.array([0.5, 0.0, -1.0]) / np.sqrt(1.25))
    assert (axes[:, :, 2] @ normal > 0.97).mean() > 0.9
    assert (gaussians.scale[:, 2] < 0.5 * gaussians.scale[:, :2].min(axis=1)).all()
    xy = np.round(plate.camera.project(gaussians.x)[0]).astype(int)
    assert np.abs(colours(gaussians) * 255 - plate.image[xy[:, 1], xy[:, 0]]).mean() < 8.0
