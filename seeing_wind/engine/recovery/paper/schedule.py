"""The paper's own scheme (section 3.4): frame by frame, gradient descent through the simulator. `--schedule paper`.

    L = L_motion + lambda_1 L_space + lambda_2 L_time        Eq. (14), minimised by Adam over one frame's force, then the next

Each frame starts from the detached state at the end of the frame before; the time encoder starts from that frame's weights; the planes and
the decoder are optimised further in every frame. The scheme is here for comparison with the default solve: fitting one frame at a time
leaves a velocity error that the next frame undoes with the opposite sign, and stiff strain converges slowly. It differs from the paper in
this: the initial velocity is estimated (`start.first_look`), tracks are compared in pixels, and the field's gradient acts on the particles,
as everywhere in this engine.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch.nn.utils import parameters_to_vector

from ...errors import SimulationError
from ...field.adam import adam_state, in_parts, restore
from ...field.optimisers import Adam
from ...field.torch_threads import one_torch_thread
from ...materials import PLASTIC_LAWS, Material
from ...mpm.autograd import simulate
from ...mpm.model import Model
from ...mpm.model_for import model_for
from ...progress import Journal, Progress
from ...record_arrays import from_arrays, to_arrays
from ...records import Outcome, Particles, PointTargets, Recovery
from ...settings import RecoverSettings
from ..diagnostics.missed import fall_of, verdict
from ..diagnostics.remarks import ALONG_VIEW
from ..recover import channels_of, check_body
from ..targets.channels import views_of
from .field import DescentField, descent_field
from .losses import MotionLoss, Targets, TrackingLoss
from .start import first_look

GRADIENT_CLIP = 1.0
RATE_FLOOR = 0.05
"""Within a frame the learning rate falls along a cosine to this share of its initial value."""
FOUND = 0.001
"""A frame is done when the misfit, scaled to be 1 without any force, is below this."""
PATIENCE = 25
"""Iterations without a new best misfit after which a frame ends."""

State = tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]


@dataclass(frozen=True)
class _Frame:
    """The best solution found for one frame."""

    misfit: float
    acceleration: np.ndarray
    x: np.ndarray
    v: np.ndarray
    C: np.ndarray
    F: np.ndarray
    """x, v, C and F are the particles' state at the end of the frame."""
    weights: np.ndarray
    """All parameters, concatenated."""
    at: int
    """The iteration that found it."""
    iterations: int = 0
    """Number of iterations made for the frame."""


def recover_by_descent(
    particles: Particles,
    material: Material,
    targets: Targets,
    fps: float,
    settings: RecoverSettings,
    progress: Progress,
    loss: Callable[[float], MotionLoss] | None = None,
    journal: Journal = Journal(),
) -> Recovery:
    """Find the force frame by frame; arguments and result as for `recover`.

    Args:
        targets: points or tracks; if `loss` is given, they are used only for the start and the residual.
        settings: `representation` is what is optimised, `frame_iterations` limits the iterations per frame.
        loss: makes the motion loss, given the distance [m] that the expected force moves the body by in a frame; None for `TrackingLoss`.

    Returns:
        The forces that moved the simulation. As there is no posterior here, the deviation is estimated from the residual and from how the
        force alternates between frames. The outcome is `converged` if every frame reached its tolerance.

    Raises:
        UsageError, ObjectError, SimulationError, Cancelled: as `recover`.
    """
    began = time.monotonic()
    check_body(particles, fps)
    views = views_of(targets)
    frames = len(views[0].visible) - 1
    progress.update(0.0, "Preparing the body")
    model, notes = model_for(particles, material, fps, gravity=settings.gravity)
    start = first_look(particles, targets, fps, model.gravity)
    reach = 0.5 * start.acceleration * model.frame_dt**2
    tracking = TrackingLoss(particles, targets, reach)
    channels = [channels_of(particles, one, material.law in PLASTIC_LAWS) for one in views]
    with torch.random.fork_rng(devices=[]), one_torch_thread():
        torch.manual_seed(settings.seed)
        field = descent_field(settings.representation, frames, start.box, particles.spacing, start.acceleration)
        motion = tracking if loss is None else loss(reach)
        first = tuple(torch.from_numpy(np.array(array)) for array in (particles.x, start.velocity, start.spin))
        state: State = (*first, torch.eye(3, dtype=torch.float64).repeat(len(particles.x), 1, 1))  # type: ignore[assignment]
        lightness = torch.from_numpy(1.0 / particles.relative_density)
        descent = _Descent(model, field, lightness, motion, settings.frame_iterations, frames, progress, journal)
        for t in range(frames):
            state = descent.frame(t, state)
    x = np.stack([particles.x, *descent.x])
    residual = tracking.distance(x)
    in_metres = isinstance(targets, PointTargets)
    missed = sum(misfit > FOUND for misfit in descent.misfits)
    notes += _remarks(0 if in_metres else len(views), missed, frames)
    acceleration = np.stack(descent.accelerations)
    fall = fall_of(particles, acceleration, x, start.velocity, fps, settings.gravity)
    notes[:0] = verdict(particles, channels, x, residual, fall)
    density = particles.density(material)[:, None]
    metres = residual if in_metres else residual * _metres_per_pixel(targets, particles)
    return Recovery(
        outcome=Outcome.MAX_ITERATIONS if missed else Outcome.CONVERGED,
        force_density=density * acceleration,
        deviation=density * deviation(acceleration, metres, fps),
        x=x,
        F=np.stack([np.tile(np.eye(3), (len(particles.x), 1, 1)), *descent.F]),
        v0=start.velocity,
        residual=residual,
        residual_unit="m" if in_metres else "px",
        iterations=descent.iterations,
        seconds=time.monotonic() - began,
        notes=notes,
    )


def _remarks(cameras: int, missed: int, frames: int) -> list[str]:
    """Notes on what one camera cannot show, and on the frames whose solve ended too early; `cameras` is 0 for points in 3D."""
    notes = []
    if cameras == 1:
        notes.append(ALONG_VIEW)
    if missed:
        notes.append(
            f"In {missed} of {frames} frames the solve ended before the misfit was below {100.0 * FOUND:g} % of how far the force moves "
            "the body in a frame."
        )
    return notes


class _Descent:
    """The optimisation, frame by frame through the clip, and the results so far."""

    def __init__(
        self, model: Model, field: DescentField, lightness: torch.Tensor, loss: MotionLoss, limit: int, frames: int, progress: Progress,
        journal: Journal,
    ) -> None:  # fmt: skip
        """lightness: (N,) density of the body's material, in whose units the field is, in units of a particle's own."""
        self.model, self.field, self.lightness = model, field, lightness
        self.loss, self.limit, self.frames = loss, limit, frames
        self.progress, self.journal = progress, journal
        self.iterations = 0
        self.accelerations: list[np.ndarray] = []
        self.x: list[np.ndarray] = []
        self.F: list[np.ndarray] = []
        self.misfits: list[float] = []

    def frame(self, t: int, state: State) -> State:
        """Optimise frame `t` from the state at its start and keep the best force; returns the detached state at its end."""
        self.field.begin(t, state[0].numpy())
        self.loss.begin(state[0].numpy(), t + 1)
        best = self.journal.once("frame", _Frame, partial(self._best, t, state), t)
        with torch.no_grad():
            for one, kept in in_parts(best.weights, self.field.parameters()):
                one.copy_(kept)
        self.accelerations.append(best.acceleration)
        self.x.append(best.x)
        self.F.append(best.F)
        self.misfits.append(best.misfit)
        self.iterations += best.iterations
        return tuple(torch.from_numpy(part) for part in (best.x, best.v, best.C, best.F))  # type: ignore[return-value]

    def _best(self, t: int, state: State) -> _Frame:
        """The best solution that descent finds for frame `t`; the field is left with the parameters of the last iteration."""
        parameters = self.field.parameters()
        optimiser = Adam(parameters, lr=self.field.rate)
        decay = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, self.limit, eta_min=RATE_FLOOR * self.field.rate)
        best: _Frame | None = None
        iteration = steps = 0
        loop = self.journal.loop("iterations", t)
        done, kept = loop.resume()
        if done:
            restore(optimiser, decay, kept, done)
            best, steps = from_arrays(_Frame, kept, "best."), done
        for iteration in range(done, self.limit):
            try:
                misfit, acceleration, end = self._run(state)
            except SimulationError:
                if best is None:
                    raise
                break  # the last optimiser step went too far; the best solution before it is kept
            value = float(misfit.detach())
            if best is None or value < best.misfit:
                x, v, C, F = (part.numpy() for part in end)
                best = _Frame(value, acceleration, x, v, C, F, _weights(parameters), iteration)
            share = (t + iteration / self.limit) / self.frames
            self.progress.update(share, f"Frame {t + 1} of {self.frames}, iteration {iteration}", misfit=round(best.misfit, 5))
            if value < FOUND or iteration - best.at > PATIENCE or iteration + 1 == self.limit:
                break
            optimiser.zero_grad()
            (misfit + self.field.roughness()).backward()
            self.field.confine()
            torch.nn.utils.clip_grad_norm_(parameters, GRADIENT_CLIP)
            optimiser.step()
            decay.step()
            steps += 1
            loop.reached(steps, partial(_so_far, optimiser, best))
        assert best is not None
        return replace(best, iterations=steps)

    def _run(self, state: State) -> tuple[torch.Tensor, np.ndarray, State]:
        """Simulate one frame with the field's current parameters: misfit, acceleration (N, 3) [m/s²], state at the frame's end."""
        force, slope = self.field.acceleration()
        acceleration, gradient = self.lightness[:, None] * force, self.lightness[:, None, None] * slope
        x0, v0, C0, F0 = state
        x, v, C, F = simulate(self.model, x0, v0, acceleration[None], gradient[None], C0=C0, F0=F0, progress=self.progress)
        end = (x[-1].detach(), v[-1].detach(), C[-1].detach(), F[-1].detach())
        return self.loss(x[-1], F[-1]), acceleration.detach().numpy(), end


def _so_far(optimiser: Adam, best: _Frame) -> dict[str, np.ndarray]:
    return adam_state(optimiser) | to_arrays(best, "best.")


def _weights(parameters: list[torch.nn.Parameter]) -> np.ndarray:
    return parameters_to_vector(parameters).detach().numpy().copy()


def deviation(acceleration: np.ndarray, residual: np.ndarray, fps: float) -> np.ndarray:
    """Estimated standard deviation (T, N, 3) [m/s²] of `acceleration` (T, N, 3), the same in all directions.

    It has two parts: the acceleration that corresponds to a frame's `residual` r (T+1,) [m], 2 r / dt²; and the part of the force that
    alternates from frame to frame, which no wind does but a frame-by-frame fit leaves behind. The latter is estimated from second
    differences in time, whose standard deviation is sqrt(6) times that of independent errors.
    """
    alternating = np.zeros(acceleration.shape[:2])
    if len(acceleration) > 2:
        second = acceleration[2:] - 2.0 * acceleration[1:-1] + acceleration[:-2]
        inner = np.sqrt((second**2).mean(axis=-1) / 6.0)
        alternating = np.concatenate([inner[:1], inner, inner[-1:]])
    missed = 2.0 * residual[1:, None] * fps**2 / np.sqrt(3.0)
    return np.repeat(np.hypot(alternating, missed)[..., None], 3, axis=-1)


def _metres_per_pixel(targets: Targets, particles: Particles) -> float:
    assert not isinstance(targets, PointTargets)
    sizes = [np.median(one.camera.project(particles.x, 0)[1]) / one.camera.fx for one in targets]
    return float(np.mean(sizes))
