"""Refinement of the stored field through the differentiable simulator, over all frames and all its parameters at once.

    minimise  |x(f) - x*|² / s²  +  A |f - f*|² / |f*|²  +  lambda_1 L_space  +  lambda_2 L_time          after Eq. (14)

x* is the recovered motion and f* the recovered force. Distillation fits only the force, point by point, and its errors accumulate as the
body moves on; here the field is fitted by where it takes the body. The tracks are not used again, so noise that the solve removed stays
removed.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch.nn.utils import parameters_to_vector

from ...conventions import NO_GRAVITY, in_units
from ...errors import SimulationError
from ...field.adam import in_parts
from ...field.force_field import ForceField
from ...field.optimisers import LBFGS
from ...field.representations.neural import ForceFieldNeural, NeuralModule
from ...field.torch_threads import one_torch_thread
from ...materials import Material
from ...mpm.autograd import simulate
from ...mpm.model import Model
from ...mpm.model_for import model_for
from ...progress import Journal, Progress
from ...records import Particles, Recovery, as_found, body_as_found
from ...settings import RecoverSettings
from .field import OFFSET, quotient, star

STRAY = 1e-3
"""s: unit of distance in the loss, relative to the root mean square distance that the body travels."""
ANCHOR = 1e5
"""A: an error of 1 % in the force costs as much as a body that is 3 s away in all frames; with a smaller weight, forces that cancel each
other along the way creep in."""
SPACE_WEIGHT, TIME_WEIGHT = 1e-3, 1e-5
"""lambda_1 and lambda_2, those of the distillation."""
WEAK = 0.1
"""Squared errors of the force are divided by its square plus the mean square times the square of this."""
SEGMENT = 16
"""Frames after which derivatives are cut, to limit memory (truncated back-propagation through time, Williams and Peng 1990)."""
MEMORY = 20
"""Steps that L-BFGS remembers."""

State = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]


@dataclass(frozen=True)
class Refined:
    """A field, and how far [m] a simulation in it strays from the recovered motion, before and after the refinement.

    Distances are root mean squares over particles and frames.
    """

    field: ForceField
    before: float
    after: float


def refine(
    field: ForceField,
    recovery: Recovery,
    particles: Particles,
    material: Material,
    settings: RecoverSettings,
    progress: Progress,
    journal: Journal = Journal(),
) -> Refined:
    """Refine a distilled field with at most `settings.refine` iterations of L-BFGS; it is returned as it was if they do not improve it.

    Args:
        field: distilled from `recovery`; point forces have nothing to refine.
        particles: the body of the recovery.
        material: as given; the stiffness that the recovery found, if any, takes the place of its own.
    """
    if not isinstance(field, ForceFieldNeural):
        progress.warn("The field was not refined: point forces are those that were solved for.")
        return Refined(field, 0.0, 0.0)
    module = copy.deepcopy(field.module).requires_grad_(True)
    try:
        with one_torch_thread():
            run = _Run(field, module, recovery, particles, as_found(material, recovery), settings, journal)
            before, after = run.descend(settings.refine, progress)
    except SimulationError as error:
        progress.warn(f"The field was not refined: the body breaks down under it. {error.message}")
        return Refined(field, 0.0, 0.0)
    if not after < before:
        return Refined(field, before, before)
    return Refined(type(field)(field.box, field.fps, field.frames, module, field.scale, field.confidence), before, after)


@dataclass(frozen=True)
class _Loss:
    """The loss at one set of parameters."""

    value: float
    stray: float
    """Distance [m]."""
    derivatives: np.ndarray
    """With respect to all parameters, concatenated."""


@dataclass(frozen=True)
class _Segment:
    """The contribution of a segment of frames to the loss."""

    loss: float
    squares: float
    """Sum over the segment's frames of the mean square distance [m²]."""
    x: np.ndarray
    v: np.ndarray
    C: np.ndarray
    F: np.ndarray
    """x, v, C and F are the particles' state at the segment's end."""
    derivatives: np.ndarray
    """With respect to all parameters, summed over this segment and those before."""


class _Run:
    """One refinement in progress."""

    def __init__(
        self,
        field: ForceFieldNeural,
        module: NeuralModule,
        recovery: Recovery,
        particles: Particles,
        material: Material,
        settings: RecoverSettings,
        journal: Journal,
    ) -> None:
        self.journal = journal
        self.module, self.box, self.scale = module, field.box, field.scale / material.density
        model, _ = model_for(
            body_as_found(particles, recovery), material, field.fps,
            gravity=settings.gravity if recovery.borne is None else NO_GRAVITY, clamp_depth=recovery.clamp_depth,
        )  # fmt: skip
        self.model: Model = replace(model, substeps=recovery.substeps or model.substeps)
        self.path = torch.from_numpy(np.asarray(recovery.x, np.float64))
        self.lightness = torch.from_numpy(1.0 / particles.relative_density)
        self.force = torch.from_numpy(recovery.force_density / particles.density(material)[:, None])
        size = self.force.square().sum(dim=-1)
        self.weight = 1.0 / (size + WEAK**2 * size.mean() + 1e-30)
        self.step = OFFSET * particles.spacing
        travelled = (self.path - self.path[0]).square().sum(dim=-1).mean().sqrt()
        self.unit = STRAY * max(float(travelled), 1e-3 * particles.spacing)
        rest = torch.eye(3, dtype=torch.float64).repeat(len(particles.x), 1, 1)
        self.start: State = (self.path[0], torch.from_numpy(np.array(recovery.v0, np.float64)), torch.zeros_like(rest), rest)

    def descend(self, steps: int, progress: Progress) -> tuple[float, float]:
        """Optimise, and leave the best parameters in the module. Returns how far [m] the body strays before and after."""
        parameters = list(self.module.parameters())
        optimiser = LBFGS(parameters, max_iter=steps, history_size=MEMORY, line_search_fn="strong_wolfe")
        loss, stray = self.backward(progress, "refining the field")
        before = after = stray
        kept = [one.detach().clone() for one in parameters]
        asked = 0

        def closure() -> float:
            nonlocal loss, after, kept, asked
            optimiser.zero_grad()
            now, stray = self.backward(progress, f"refining the field, {in_units(after, 'm')} off", asked / (1.25 * steps))
            asked += 1
            if now < loss:
                loss, after, kept = now, stray, [one.detach().clone() for one in parameters]
            return now

        try:
            optimiser.step(closure)
        except SimulationError as error:
            progress.warn(f"Refining the field ended early: a trial broke the body. {error.message}")
        with torch.no_grad():
            for one, best in zip(parameters, kept, strict=True):
                one.copy_(best)
        return before, after

    def backward(self, progress: Progress, what: str, done: float = 0.0) -> tuple[float, float]:
        """The loss and the distance [m] by which the body strays; the loss's derivatives are left in the parameters' `grad`."""
        found = self.journal.once("loss", _Loss, partial(self._loss, progress, what, done), self._parameters())
        self._derive(found.derivatives)
        return found.value, found.stray

    def _loss(self, progress: Progress, what: str, done: float) -> _Loss:
        frames, total, squares = len(self.force), 0.0, 0.0
        state, derivatives = self.start, np.zeros_like(self._parameters())
        for begin in range(0, frames, SEGMENT):
            segment = range(begin, min(begin + SEGMENT, frames))
            found = self.journal.once("segment", _Segment, partial(self._segment, segment, state, derivatives, progress), begin)
            total, squares, derivatives = total + found.loss, squares + found.squares, found.derivatives
            state = tuple(torch.from_numpy(part) for part in (found.x, found.v, found.C, found.F))  # type: ignore[assignment]
            progress.update(min(done, 1.0), what)
        self._derive(derivatives)
        space, time = self.module.roughness()
        rough = SPACE_WEIGHT * space + TIME_WEIGHT * time
        rough.backward()
        return _Loss(total + float(rough.detach()), (squares / frames) ** 0.5, self._derivatives())

    def _segment(self, segment: range, state: State, derivatives: np.ndarray, progress: Progress) -> _Segment:
        self._derive(derivatives)
        frames, squares, loss = len(self.force), 0.0, torch.zeros((), dtype=torch.float64)
        for t, acceleration, after in self._frames(segment, state, progress):
            off = (after[0] - self.path[t + 1]).square().sum(dim=-1).mean()
            anchor = (self.weight[t] * (acceleration - self.force[t]).square().sum(dim=-1)).mean()
            loss = loss + (off / self.unit**2 + ANCHOR * anchor) / frames
            squares += float(off.detach())
            state = after
        loss.backward()
        x, v, C, F = (part.detach().numpy() for part in state)
        return _Segment(float(loss.detach()), squares, x, v, C, F, self._derivatives())

    def _parameters(self) -> np.ndarray:
        return parameters_to_vector(self.module.parameters()).detach().numpy()

    def _derivatives(self) -> np.ndarray:
        return torch.cat([one.grad.reshape(-1) for one in self.module.parameters() if one.grad is not None]).numpy().copy()

    def _derive(self, values: np.ndarray) -> None:
        """Set the parameters' `grad` from their concatenated derivatives."""
        for one, part in in_parts(values, self.module.parameters()):
            one.grad = part.clone()

    def _frames(self, segment: range, state: State, progress: Progress) -> Iterator[tuple[int, torch.Tensor, State]]:
        """For each frame of a segment: its number, the acceleration (N, 3) [m/s²] on the recovered path, and the state at its end."""
        for t in segment:
            acceleration, gradient = self._field(t)
            # The field beside the recovered path, to first order: the body strays too little for more.
            felt = acceleration + torch.einsum("nij,nj->ni", gradient, state[0] - self.path[t])
            x, v, C, F = simulate(
                self.model, state[0], state[1], felt[None], gradient[None], C0=state[2], F0=state[3], first_frame=t, progress=progress
            )
            state = (x[-1], v[-1], C[-1], F[-1])
            yield t, acceleration, state

    def _field(self, t: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Acceleration (N, 3) [m/s²] and its gradient (N, 3, 3) [1/s²] along the recovered path."""
        points = star(self.path[t].numpy(), self.step)
        s, frame = torch.from_numpy((points - self.box[0]) / (self.box[1] - self.box[0])), torch.full((len(points),), t)
        force, slope = quotient(self.scale * self.module(s, frame), self.step)
        return self.lightness[:, None] * force, self.lightness[:, None, None] * slope
