"""Distillation: from the forces solved on the particles to a force field that can be sampled anywhere.

The representation is fitted to samples (x[t, n], t, f[t, n]), each weighted by how well it is known; the last layer, in which the
fit is linear, is then solved exactly. Away from the body nothing was seen: a few samples of low weight there hold the field at each
frame's mean force, so that an object inserted beside the recorded path meets the same wind and not an arbitrary extrapolation. The
field's confidence shows where this is so.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from scipy.spatial import cKDTree

from ..errors import UsageError
from ..progress import Journal, NoProgress, Progress
from ..records import Particles, Recovery
from .adam import adam_state, restore
from .confidence import confidence_map
from .force_field import ForceField
from .optimisers import Adam
from .representations.kplanes import ForceFieldKPlanes, KPlanes
from .representations.neural import NeuralModule
from .representations.planes import Stencil
from .representations.point import ForceFieldPoint
from .representations.triplane import CausalTriPlane, ForceFieldTriPlane
from .torch_threads import one_torch_thread

ITERATIONS = 800
"""Adam iterations for clips up to two seconds; longer clips get more, see `_iterations`."""

BATCH = 1024
SPACE_WEIGHT, TIME_WEIGHT = 1e-3, 1e-5
"""lambda_1 and lambda_2 of Eq. (14), for normalised forces."""

WEAK = 0.1
"""Errors are weighted relative to the local force plus this fraction of the clip's root mean square force."""

CELLS = 4.5
"""Cells of the finest planes per root mean square radius of the body."""

ACCURATE, SLOW = 0.05, 0.4
"""A fit whose relative misfit exceeds ACCURATE is repeated with the learning rates times SLOW."""

BACKGROUND_SHARE, BACKGROUND_WEIGHT = 0.1, 0.005
"""Samples away from the body, over those on it, and their weight relative to that of a typical sample."""


@dataclass(frozen=True)
class Samples:
    """The S samples that the representation is fitted to, normalised."""

    s: torch.Tensor
    """(S, 3) position in the box, 0..1."""
    frame: torch.Tensor
    """(S,) int64 frame interval."""
    force: torch.Tensor
    """(S, 3) force density over the field's scale."""
    weight: torch.Tensor
    """(S,) weight of the squared error, about one on average."""


def distill(
    recovery: Recovery,
    particles: Particles,
    fps: float,
    representation: str = "causal_triplane",
    seed: int = 0,
    progress: Progress = NoProgress(),
    journal: Journal = Journal(),
) -> ForceField:
    """Fit a representation to a recovery's forces.

    Args:
        recovery: forces (T, N, 3) [N/m³] at x[t], and their posterior deviation.
        particles: the body, for its spacing.
        representation: causal_triplane, kplanes or point.
        seed: for the initial weights and the batches; the same seed gives the same field.
        journal: keeps the fit's progress; its stamp must depend on all other arguments.

    Raises:
        UsageError: for an unknown representation, or forces that are not finite (a recovery that diverged).
    """
    if representation not in ("causal_triplane", "kplanes", "point"):
        raise UsageError(f"There is no force representation {representation}.", "Use causal_triplane, kplanes or point.")
    for name in ("force_density", "deviation", "x"):
        if not np.isfinite(getattr(recovery, name)).all():
            raise UsageError(f"The recovery's {name} is not finite.", "It diverged: recover with other settings.")
    frames = len(recovery.force_density)
    x = recovery.x[:frames]
    box, confidence = _box(x, particles.spacing), confidence_map(recovery, particles)
    if representation == "point":
        return ForceFieldPoint(box, fps, frames, x, recovery.force_density, confidence)

    # if there is no force at all, any scale will do
    scale = float(np.sqrt((recovery.force_density**2).sum(axis=-1).mean())) or 1.0
    samples = _samples(recovery, x, box, scale, seed)
    with torch.random.fork_rng(devices=[]), one_torch_thread():
        torch.manual_seed(seed)
        module = _best(lambda: _module(representation, frames, box, x[0]), samples, _iterations(frames), progress, journal)
    if isinstance(module, KPlanes):
        return ForceFieldKPlanes(box, fps, frames, module, scale, confidence)
    return ForceFieldTriPlane(box, fps, frames, module, scale, confidence)


def _best(make: Callable[[], NeuralModule], samples: Samples, iterations: int, progress: Progress, journal: Journal) -> NeuralModule:
    """A fitted module. Adam at full rates sometimes fails; the fit is then repeated at lower rates, and the better one is taken."""
    first = make()
    if not samples.force.any():
        return first  # a new module has no force
    misfit = _fit(first, samples, iterations, 1.0, progress, journal)
    if misfit < ACCURATE:
        return first
    second = make()
    slow = _fit(second, samples, 2 * iterations, SLOW, progress, journal)
    module, misfit = (second, slow) if slow < misfit else (first, misfit)
    if misfit >= ACCURATE:
        progress.warn(f"The field differs from the solved forces by {100 * misfit:.0f} %: they vary more than the representation can.")
    return module


def _iterations(frames: int) -> int:
    return min(int(ITERATIONS * max(1.0, math.sqrt(frames / 48))), 3000)


def _box(x: np.ndarray, spacing: float) -> np.ndarray:
    """Box (2, 3) [m] around the swept volume, with a margin; no side is shorter than a tenth of the longest."""
    low, high = x.min(axis=(0, 1)), x.max(axis=(0, 1))
    longest = max(float((high - low).max()), spacing)
    margin = np.maximum(0.05 * longest + 2 * spacing, (0.1 * longest - (high - low)) / 2)
    return np.stack([low - margin, high + margin])


def _module(representation: str, frames: int, box: np.ndarray, body: np.ndarray) -> NeuralModule:
    """A new module, with plane cells in proportion to the body: a field varies over the size of a body, not of a particle."""
    radius = float(np.sqrt(((body - body.mean(axis=0)) ** 2).sum(axis=1).mean())) or 1.0
    cells = (box[1] - box[0]) / radius * CELLS
    fine, coarse = _nodes(cells, 8, 44), _nodes(cells / 2.5, 5, 18)
    if representation == "kplanes":
        return KPlanes(frames, fine)
    return CausalTriPlane(frames, [coarse, fine])


def _nodes(cells: np.ndarray, fewest: int, most: int) -> tuple[int, int, int]:
    x, y, z = (int(count) for count in np.clip(np.ceil(cells), fewest, most))
    return x, y, z


def _samples(recovery: Recovery, x: np.ndarray, box: np.ndarray, scale: float, seed: int) -> Samples:
    frames, count = recovery.deviation.shape[:2]
    force, deviation = recovery.force_density / scale, np.sqrt((recovery.deviation**2).mean(axis=-1)) / scale
    size = np.linalg.norm(force, axis=-1)
    # errors are relative to the force itself; samples that are known less well than the typical one get less weight
    typical = float(np.median(deviation)) or 1.0
    weight = 1 / ((size + WEAK) ** 2 * (1 + (deviation / typical) ** 2))
    weight /= weight.mean()
    random, radius = np.random.default_rng(seed), float(np.sqrt(x[0].var(axis=0).sum()))
    frame, points = np.repeat(np.arange(frames), count), x.reshape(-1, 3)
    per_frame = math.ceil(BACKGROUND_SHARE * count)
    away = random.uniform(box[0], box[1], (frames, per_frame, 3))
    far = np.stack([cKDTree(x[t]).query(away[t])[0] > radius for t in range(frames)])
    mean = np.broadcast_to(force.mean(axis=1, keepdims=True), away.shape)
    away_frame = np.broadcast_to(np.arange(frames)[:, None], far.shape)[far]
    points, frame = np.concatenate([points, away[far]]), np.concatenate([frame, away_frame])
    return Samples(
        s=torch.from_numpy((points - box[0]) / (box[1] - box[0])).float(),
        frame=torch.from_numpy(frame),
        force=torch.from_numpy(np.concatenate([force.reshape(-1, 3), mean[far]])).float(),
        weight=torch.from_numpy(np.concatenate([weight.ravel(), np.full(len(away_frame), BACKGROUND_WEIGHT)])).float(),
    )


def _fit(module: NeuralModule, samples: Samples, iterations: int, pace: float, progress: Progress, journal: Journal) -> float:
    """Fit by Adam on random batches, with one rise and fall of the learning rates (times `pace`), then solve the last layer exactly.

    Returns the relative misfit: weighted root mean square error over weighted root mean square force.
    """
    rows, carry = module.stencil(samples.s, samples.frame)
    groups = module.rates()
    rates = [pace * group["lr"] for group in groups]
    optimiser = Adam(groups, betas=(0.9, 0.99))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, rates, total_steps=iterations, pct_start=0.1)
    # Half of the samples are drawn in proportion to the squared force, because an impact is only a few frames of many.
    power = samples.force.double().square().sum(dim=1)
    drawn = (power + power.mean().clamp_min(1e-30)).cumsum(dim=0)
    loop = journal.loop("iterations", pace)
    done, kept = loop.resume()
    if done:
        restore(optimiser, schedule, kept, done)
    for iteration in range(done, iterations):
        pick = torch.searchsorted(drawn, torch.rand(min(BATCH, len(samples.s)), dtype=drawn.dtype) * drawn[-1])
        force = module.decoder(module.latent((rows[pick], carry[pick]), samples.frame[pick]))
        data = (samples.weight[pick, None] * (force - samples.force[pick]).square()).mean()
        space, time = module.roughness()
        (data + SPACE_WEIGHT * space + TIME_WEIGHT * time).backward()
        torch.nn.utils.clip_grad_norm_(module.parameters(), 1.0)
        optimiser.step()
        schedule.step()
        optimiser.zero_grad()
        if iteration % 50 == 0:
            progress.update(iteration / iterations, "distilling the field", misfit=float(data.detach()))
        loop.reached(iteration + 1, partial(adam_state, optimiser))
    return _solve_last(module, samples, (rows, carry))


@torch.no_grad()
def _solve_last(module: NeuralModule, samples: Samples, stencil: Stencil) -> float:
    """Weighted least squares for the decoder's last layer, slightly regularised towards Adam's result so that it cannot blow up.

    Returns the relative misfit; see `_fit`.
    """
    hidden = module.decoder[:-1](module.latent(stencil, samples.frame)).double()
    hidden = torch.cat([hidden, torch.ones(len(hidden), 1, dtype=hidden.dtype)], dim=1)
    weighted = hidden * samples.weight.double()[:, None]
    last = module.decoder[-1]
    assert isinstance(last, torch.nn.Linear)
    found = torch.cat([last.weight, last.bias[:, None]], dim=1).T.double()
    normal = weighted.T @ hidden
    ridge = 1e-6 * normal.diagonal().mean() * torch.eye(len(normal), dtype=normal.dtype)
    solved = found + torch.linalg.solve(normal + ridge, weighted.T @ (samples.force.double() - hidden @ found))
    last.weight.copy_(solved[:-1].T)
    last.bias.copy_(solved[-1])
    weight = samples.weight.double()[:, None]
    squared = (weight * (samples.force - hidden @ solved).square()).sum() / (weight * samples.force.square()).sum().clamp_min(1e-30)
    return float(squared.sqrt())
