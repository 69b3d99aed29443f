"""resimulated.mp4: the look carried by the motion, and how alike it is to the clip."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from seeing_wind.engine.errors import ClipError
from seeing_wind.engine.look.report import resimulated as module
from seeing_wind.engine.look.report.backdrop import behind, relit
from seeing_wind.engine.look.report.footage import Footage, reduced
from seeing_wind.engine.look.report.resimulated import (
    SAMPLED,
    frames_measured,
    likeness,
    look_over_clip,
    psnr,
    resimulated,
    ssim,
    write_resimulated,
)
from seeing_wind.engine.observe.clip.frames import Clip
from seeing_wind.engine.observe.clip.lens import Lens
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Attachment, Body, Gaussians, Observation, Recovery
from seeing_wind.engine.recovery import journal as journals
from seeing_wind.engine.recovery.journal import TakeJournal
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


def footage(filmed: np.ndarray, seen: Observation) -> Footage:
    """The clip in memory, at its own size."""
    clip = Clip("", filmed, seen.fps, 0, filmed.shape[1:3], tuple(range(len(filmed))), filmed)
    return Footage(clip, seen, Lens(seen.camera), seen)


def test_the_motion_that_was_filmed_is_like_the_clip_and_another_is_not(tmp_path):
    seen, blobs, found = coloured()
    filmed = np.stack([resimulated(seen.background, seen, blobs, found, t) for t in range(FRAMES + 1)])
    masks = (np.abs(filmed.astype(int) - seen.background) > 2).any(axis=-1)
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
    with pytest.raises(ClipError, match="The clip has 3 frames, the recovery"):
        write_resimulated(Take(tmp_path / "short"), filmed[:3], seen, blobs, found)


def test_a_kill_costs_no_part_that_was_rendered(tmp_path, monkeypatch):
    seen, blobs, found = coloured()
    filmed, rendered = np.stack([seen.background] * (FRAMES + 1)), []
    whole = write_resimulated(Take(tmp_path / "whole"), filmed, seen, blobs, found)

    class Killed(BaseException):
        pass

    def render(image, observation, body, recovery, t):
        rendered.append(t)
        if len(rendered) == 6:
            raise Killed
        return resimulated(image, observation, body, recovery, t)

    monkeypatch.setattr(module, "PART", 2)
    monkeypatch.setattr(module, "resimulated", render)
    monkeypatch.setattr(journals, "LATEST", 0.0)
    take = Take(tmp_path / "killed")
    with pytest.raises(Killed), TakeJournal(take, "film", NoProgress()) as journal:
        write_resimulated(take, filmed, seen, blobs, found, journal=journal)
    with TakeJournal(take, "film", NoProgress()) as journal:
        assert write_resimulated(take, filmed, seen, blobs, found, journal=journal) == whole
    assert rendered == [0, 1, 2, 3, 4, 5, 4, 5]
    assert take.file("resimulated.mp4").read_bytes() == (tmp_path / "whole" / "resimulated.mp4").read_bytes()


def test_a_moving_camera_keeps_each_frames_own_background():
    seen, blobs, found = coloured()
    poses = np.repeat(seen.camera.camera_to_world[None], FRAMES + 1, axis=0)
    seen = dataclasses.replace(seen, camera=dataclasses.replace(seen.camera, camera_to_world=poses))
    filmed = np.full((FRAMES + 1, *seen.image.shape), 90, np.uint8)
    filmed[2] = 200
    frames = [resimulated(filmed[t], seen, blobs, found, t) for t in range(FRAMES + 1)]
    assert (frames[2][:10] == 200).all() and (frames[1][:10] == 90).all()


def test_the_plate_gets_the_frames_shadow_and_not_the_object():
    rng = np.random.default_rng(2)
    plate = cv2.GaussianBlur(rng.uniform(60, 200, (90, 120, 3)), (0, 0), 1.0).round().astype(np.uint8)
    rows, columns = np.mgrid[:90, :120]
    shade = 1.0 - 0.5 / (1.0 + np.exp((columns - 40.0) / 6.0))
    lit = plate * shade[..., None]
    mask = (rows > 30) & (rows < 60) & (columns > 50) & (columns < 90)
    image = np.where(mask[..., None], [255, 0, 0], lit).round().astype(np.uint8)
    found = relit(plate, image, mask)
    near = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert np.abs(found - lit)[~near].max() < 6.0 and np.abs(plate - lit)[~near].max() > 60.0
    assert np.abs(found - lit)[mask].mean() < 6.0, "behind the object, where no light is seen, it is that from around"
    assert (relit(plate, plate, mask) == plate).all() and (relit(np.zeros_like(plate), image, mask) == 0).all()


def test_a_look_for_the_whole_clip_keeps_the_motion(tmp_path):
    seen, blobs, found = coloured()
    filmed = np.stack([resimulated(seen.background, seen, blobs, found, t) for t in range(FRAMES + 1)])
    seen = dataclasses.replace(seen, masks=(np.abs(filmed.astype(int) - seen.background) > 2).any(axis=-1))
    faded = dataclasses.replace(blobs.gaussians, sh=0.3 * blobs.gaussians.sh)
    pale = dataclasses.replace(blobs, gaussians=faded)
    before = write_resimulated(Take(tmp_path / "pale"), filmed, seen, pale, found)
    fitted = look_over_clip(footage(filmed, seen), pale, found)
    after = write_resimulated(Take(tmp_path / "fitted"), filmed, seen, fitted, found)
    assert before["psnr"] < 30.0 and after["psnr"] > before["psnr"] + 8.0
    away = np.linalg.norm(fitted.gaussians.x[:, None] - blobs.gaussians.x, axis=-1).min(axis=1)
    assert away.max() < 0.025 and (fitted.particles.x == blobs.particles.x).all(), "parts of the blobs, within their width"
    carried = fitted.gaussians.attachment.follow(found.x) - fitted.gaussians.x
    assert carried == pytest.approx(np.broadcast_to((found.x - found.x[0]).mean(axis=1)[:, None], carried.shape), abs=1e-6)


def test_a_box_shows_what_the_whole_frame_does():
    seen, blobs, found = coloured()
    dim = (0.6 * seen.background).astype(np.uint8)
    for poses in (seen.camera.camera_to_world, np.repeat(seen.camera.camera_to_world[None], FRAMES + 1, axis=0)):
        one = dataclasses.replace(seen, camera=dataclasses.replace(seen.camera, camera_to_world=poses))
        x0, y0, x1, y1 = box = (50, 31, 103, 90)
        for part, whole in (
            (behind(one, 2, dim, box), behind(one, 2, dim)),
            (resimulated(dim, one, blobs, found, 2, box), resimulated(dim, one, blobs, found, 2)),
        ):
            assert np.abs(part.astype(int) - whole[y0:y1, x0:x1]).max() <= 1


def test_a_large_clip_is_measured_in_some_of_its_frames_at_its_own_size(tmp_path, monkeypatch):
    monkeypatch.setattr("seeing_wind.engine.look.report.footage.LONGEST", 80)
    seen, blobs, found = coloured()
    filmed = np.stack([resimulated(seen.background, seen, blobs, found, t) for t in range(FRAMES + 1)])
    seen = dataclasses.replace(seen, masks=(np.abs(filmed.astype(int) - seen.background) > 2).any(axis=-1))
    small = reduced(seen)
    assert small.image.shape == (60, 80, 3) and small.masks.shape == (FRAMES + 1, 60, 80)
    x, factor = found.x[2], 80 / 161
    assert small.camera.project(x)[0][:, 0] + 0.5 == pytest.approx(factor * (seen.camera.project(x)[0][:, 0] + 0.5))
    frames = frames_measured(seen.masks, found)
    assert frames == list(range(FRAMES + 1)) and len(frames) <= SAMPLED + 1
    pale = dataclasses.replace(blobs, gaussians=dataclasses.replace(blobs.gaussians, sh=0.3 * blobs.gaussians.sh))
    whole = write_resimulated(Take(tmp_path), filmed, seen, pale, found)
    some = likeness(footage(filmed, seen), pale, found, frames)
    assert whole["psnr"] < 40.0 and some == pytest.approx(whole, abs=0.02), "as the video of a clip that is not reduced"
    monkeypatch.setattr("seeing_wind.engine.look.report.resimulated.SAMPLED", 2)
    assert frames_measured(seen.masks, found) == [0, 1, FRAMES]
    assert likeness(footage(filmed, seen), pale, found, [0, 1, FRAMES])["measured"] == 2


def test_measures_against_their_definitions():
    rng = np.random.default_rng(0)
    a = rng.integers(0, 256, (40, 50, 3)).astype(np.uint8)
    assert psnr(a, a) == 100.0 and ssim(a, a) == pytest.approx(1.0)
    b = np.clip(a.astype(int) + 10, 0, 255)
    error = ((a - b.astype(float)) ** 2).mean()
    assert psnr(a, b.astype(np.uint8)) == pytest.approx(10 * np.log10(255.0**2 / error))
    assert abs(ssim(a, rng.integers(0, 256, a.shape).astype(np.uint8))) < 0.1
