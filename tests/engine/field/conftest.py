"""A small body tumbling through gusts, as the recovery would hand it on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.scenes.gusts import GustField
from seeing_wind.engine.field import distillation
from seeing_wind.engine.records import Outcome, Particles, Recovery

BOX = np.array([[-0.5, -0.3, -0.5], [0.5, 0.3, 0.5]])
FRAMES, COUNT, FPS = 24, 250, 30.0


def truth() -> GustField:
    """Curved across the body (waves of 0.4 m, the body measures 0.3 m) and changing within the clip."""
    return GustField(3, BOX, FPS, FRAMES, np.array([0.0, 0.0, 20.0]), 10.0, wavelength=0.4, period=0.8)


def path() -> np.ndarray:
    """(T+1, N, 3): a plate that turns, drifts and falls."""
    rest = np.random.default_rng(0).uniform([-0.1, -0.01, -0.15], [0.1, 0.01, 0.15], (COUNT, 3))
    part = np.linspace(0, 1, FRAMES + 1)
    turns = Rotation.from_euler("yx", np.stack([120 * part, 40 * np.sin(5 * part)], axis=1), degrees=True)
    drift = np.stack([0.15 * np.sin(3 * part), 0.05 * np.sin(5 * part), 0.25 - 0.5 * part], axis=1)
    return np.stack([turn.apply(rest) + move for turn, move in zip(turns, drift)])


def recovery_of(force: np.ndarray, x: np.ndarray, deviation: np.ndarray | float = 0.3) -> tuple[Recovery, Particles]:
    frames, count, _ = force.shape
    recovery = Recovery(
        outcome=Outcome.CONVERGED,
        force_density=force,
        deviation=np.repeat(np.broadcast_to(np.asarray(deviation, dtype=np.float64), (frames, count))[..., None], 3, axis=-1),
        x=x,
        F=np.tile(np.eye(3), (frames + 1, count, 1, 1)),
        v0=np.zeros((count, 3)),
        residual=np.linspace(0.2, 0.4, frames + 1),
        residual_unit="px",
        iterations=5,
        seconds=1.5,
    )
    return recovery, Particles(x[0], np.full(count, 1e-6), np.zeros(count, dtype=bool), 0.012)


@pytest.fixture(scope="session")
def tumbling() -> tuple[Recovery, Particles]:
    x, field = path(), truth()
    return recovery_of(np.stack([field.sample(x[t], t)[0] for t in range(FRAMES)]), x)


@pytest.fixture(scope="module")
def hasty():
    """Distilling with few iterations: for tests that do not look at how good the fit is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(distillation, "ITERATIONS", 40)
        yield


@pytest.fixture(scope="session")
def known_wind() -> GustField:
    return truth()
