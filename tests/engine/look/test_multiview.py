"""A ball seen from the front and from the side."""

from __future__ import annotations

import dataclasses

import numpy as np

from seeing_wind.engine.look.first_frame import with_views
from seeing_wind.engine.look.splatting import render_gaussians
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Observation
from seeing_wind.engine.settings import BuildSettings
from seeing_wind.engine.stages import build_body
from tests.engine.observations import FOCAL, HEIGHT, WIDTH, camera, observed

RADIUS, DISTANCE = 0.15, 1.0


def sphere_from(turn_degrees: float) -> Observation:
    """A ball in front of a camera that has been turned about it; its upper side red, its right half in the world green."""
    eye = camera(DISTANCE)
    angle = np.radians(turn_degrees)
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    eye = dataclasses.replace(eye, camera_to_world=turn @ eye.camera_to_world)
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    ray = np.stack([(columns - eye.cx) / FOCAL, (rows - eye.cy) / FOCAL, np.ones((HEIGHT, WIDTH))], axis=-1)
    along = DISTANCE / (ray**2).sum(-1)
    root = along**2 - (DISTANCE**2 - RADIUS**2) / (ray**2).sum(-1)
    near = along - np.sqrt(np.maximum(root, 0.0))
    world = ray * near[..., None] @ eye.camera_to_world[:3, :3].T + eye.camera_to_world[:3, 3]
    image = 60.0 + 120.0 * np.stack([world[..., 2] > 0.0, world[..., 0] > 0.0, world[..., 1] > 0.0], axis=-1)
    return dataclasses.replace(observed(root > 0.0, near, camera=eye), image=image.astype(np.uint8))


def likeness(gaussians, seen: Observation) -> float:
    """PSNR [dB] inside the mask."""
    colour, _ = render_gaussians(gaussians, seen.camera)
    error = (colour - seen.image / 255.0)[seen.masks[0]]
    return float(-10.0 * np.log10((error**2).mean()))


def test_the_side_that_only_the_second_camera_sees_is_added() -> None:
    front, side = sphere_from(0.0), sphere_from(90.0)
    alone = build_body(front, BuildSettings(particles=120))
    both = with_views(alone, front, [side], NoProgress())
    assert len(both.gaussians.x) > 1.2 * len(alone.gaussians.x)
    assert likeness(both.gaussians, side) > max(18.0, likeness(alone.gaussians, side) + 6.0)
    assert likeness(both.gaussians, front) > max(26.0, likeness(alone.gaussians, front) - 6.0)
    moved = both.gaussians.attachment.follow(both.particles.x + [0.1, 0.0, 0.0])
    assert np.abs(moved - both.gaussians.x - [0.1, 0.0, 0.0]).max() < 0.02, "they ride on the body"
    assert np.isfinite(both.gaussians.scale).all() and np.allclose(np.linalg.norm(both.gaussians.rotation, axis=1), 1.0)
