"""Distilling: determinism and empty cases, which need no good fit."""

from __future__ import annotations

import numpy as np
import torch

from seeing_wind.engine.field import distill
from seeing_wind.engine.progress import Progress

from .conftest import FPS, recovery_of


def test_the_same_seed_gives_the_same_field_and_leaves_the_random_state_alone(tumbling, hasty):
    recovery, particles = tumbling
    x = recovery.x[:3]
    short, _ = recovery_of(recovery.force_density[:2], x)
    torch.manual_seed(99)
    before = torch.random.get_rng_state()
    one, two, other = (distill(short, particles, FPS, seed=seed).sample(x[1], 1)[0] for seed in (4, 4, 5))
    assert np.array_equal(one, two) and not np.array_equal(one, other)
    assert torch.equal(before, torch.random.get_rng_state())


def test_one_frame_and_no_force_at_all(tumbling, hasty):
    recovery, particles = tumbling
    still, _ = recovery_of(np.zeros((1, *recovery.x.shape[1:])), recovery.x[:2], 0.0)
    field = distill(still, particles, FPS)
    assert field.frames == 1
    force, confidence = field.sample(recovery.x[0], 0)
    assert np.abs(force).max() < 1e-6
    assert np.isfinite(confidence).all()


def test_a_field_that_cannot_be_followed_is_said_aloud(tumbling, hasty):
    recovery, particles = tumbling
    noise = np.random.default_rng(0).normal(size=recovery.force_density.shape)
    messages: list[dict] = []
    distill(recovery_of(noise, recovery.x)[0], particles, FPS, progress=Progress(messages.append))
    assert [message["type"] for message in messages].count("warning") == 1
