"""resimulated.mp4: the look carried by the motion, and how alike it is to the clip."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from seeing_wind.engine.errors import ClipError
from seeing_wind.engine.records import Attachment, Body, Gaussians, Observation, Recovery
from seeing_wind.engine.report.resimulated import psnr, resimulated, ssim, write_resimulated
from seeing_wind.engine.take import Take

from .test_report import COUNT, FRAMES, body, observation, recovery


def coloured() -> tuple[Observation, Body, Recovery]:
    """Forty coloured blobs, one on each particle, that drift to the right and up over a speckled wall."""
    found, particles = recovery()
    rng = np.random.default_rng(1)
    ride = Attachment(np.arange(COUNT, dtype=np.int32)[:, None], np.ones((COUNT, 1)))
    look = Gaussians(
        particles.x, np.full((COUNT, 3), 0.025), np.tile([1.0, 0, 0, 0], (COUNT, 1)), np.full(COUNT, 0.95),
        rng.uniform(-1.5, 1.5, (COUNT, 1, 3)), ride,
    )  # fmt: skip
    seen = observation("")
    wall = cv2.GaussianBlur(rng.uniform(0, 255, seen.image.shape), (0, 0), 2.0).astype(np.uint8)
    seen = dataclasses.replace(seen, background=wall)
    return seen, dataclasses.replace(body(particles), gaussians=look), found


def test_the_motion_that_was_filmed_is_like_the_clip_and_another_is_not(tmp_path):
    seen, blobs, found = coloured()
    filmed = np.stack(list(resimulated(np.zeros((FRAMES + 1, *seen.image.shape), np.uint8), seen, blobs, found)))
    masks = (np.abs(filmed.astype(int) - seen.background) > 8).any(axis=-1)
    middle = [np.nonzero(mask)[1].mean() for mask in masks]
    assert np.diff(middle) == pytest.approx(0.06 * 150.0 / 2.0, abs=1.0), "0.06 m a frame, 75 px/m"
    seen = dataclasses.replace(seen, masks=masks)
    same = write_resimulated(Take(tmp_path / "same"), filmed, seen, blobs, found)
    assert same["first_psnr"] > 60.0 and same["psnr"] > 60.0 and same["ssim"] > 0.999
    still = dataclasses.replace(found, x=np.repeat(found.x[:1], FRAMES + 1, axis=0))
    other = write_resimulated(Take(tmp_path / "other"), filmed, seen, blobs, still)
    assert other["first_psnr"] > 60.0 and other["psnr"] < 25.0 and other["ssim"] < 0.9
    video = cv2.VideoCapture(str(tmp_path / "same" / "resimulated.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == FRAMES + 1
    with pytest.raises(ClipError, match="ends at picture 3"):
        write_resimulated(Take(tmp_path / "short"), filmed[:3], seen, blobs, found)


def test_a_moving_camera_keeps_each_pictures_own_background():
    seen, blobs, found = coloured()
    poses = np.repeat(seen.camera.camera_to_world[None], FRAMES + 1, axis=0)
    seen = dataclasses.replace(seen, camera=dataclasses.replace(seen.camera, camera_to_world=poses))
    filmed = np.full((FRAMES + 1, *seen.image.shape), 90, np.uint8)
    filmed[2] = 200
    pictures = list(resimulated(filmed, seen, blobs, found))
    assert (pictures[2][:10] == 200).all() and (pictures[1][:10] == 90).all()


def test_measures_against_their_definitions():
    rng = np.random.default_rng(0)
    a = rng.integers(0, 256, (40, 50, 3)).astype(np.uint8)
    assert psnr(a, a) == 100.0 and ssim(a, a) == pytest.approx(1.0)
    b = np.clip(a.astype(int) + 10, 0, 255)
    error = ((a - b.astype(float)) ** 2).mean()
    assert psnr(a, b.astype(np.uint8)) == pytest.approx(10 * np.log10(255.0**2 / error))
    assert abs(ssim(a, rng.integers(0, 256, a.shape).astype(np.uint8))) < 0.1
