"""How the motion of a body changes with the force on it and with its start: many changes at once, to first order.

One simulation of the body as it is; then every change costs a small part of another, because it shares all that depends on the body alone
(`tangent_kernels`). Elastic laws; bodies that flow, colliders and moving pins take finite differences.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import torch

from ..progress import Journal, Progress
from .checks import check_state
from .compiler import device
from .compiler.settings import compiled_in, contracted, native_vectors
from .copies import conditioned
from .failure import diagnosis, failure
from .kernels import substep, tangent_kernels
from .kernels.native import aligned, aligned_zeros
from .kernels.tangent_kernels import RECORD, SOURCE, STATE, WIDTHS
from .laws.constitutive import ELASTIC_LAWS
from .model import Model
from .state import State

LEAST_MASS = 1e-12
"""Nodes with less than this share of the lightest particle's mass do not move: a particle on the edge between two cells gives the far node
of one a weight that is rounding, and its inverse is beyond single precision."""
MOST_NUMBERS = 2**29
"""In any one array: kernels index with 32 bits, and 2 GB is more than any body asks for that has not flown apart."""
_WORK_PER_CALL = 6_000_000
"""Changes of a particle in a substep between two safe points."""


def applies_to(model: Model) -> bool:
    """Whether the changes of this model's motion can be carried."""
    return not conditioned(model) and bool(np.isin(model.law, list(ELASTIC_LAWS.values())).all())


@dataclass(frozen=True)
class Changes:
    """Changes in B directions, by the picture from which on a direction acts."""

    coefficients: np.ndarray
    """(B, T, P, 3) of the force's coefficients [m/s²]; zero before the direction's first frame."""
    v0: np.ndarray | None = None
    """(B, N, 3) of the initial velocities [m/s]."""
    C0: np.ndarray | None = None
    """(B, N, 3, 3) of the initial affine velocities [1/s]."""


def tangents(
    model: Model,
    start: State,
    phi: np.ndarray,
    dphi: np.ndarray,
    coefficients: np.ndarray,
    changes: Changes,
    progress: Progress,
    journal: Journal = Journal(),
) -> tuple[np.ndarray, np.ndarray]:
    """Motion under a force, and how it changes to first order.

    Args:
        start: the body at the first picture.
        phi, dphi: (N, P) basis at the particles' rest positions, (N, P, 3) its gradient [1/m]; the force is as in `rollout_batch`.
        coefficients: (T, P, 3) [m/s²].
        changes: directions.
        journal: keeps how far the frames have come.

    Returns:
        positions (T+1, N, 3) [m], and their changes (B, T+1, N, 3) [m], single precision.

    Raises:
        SimulationError: when the simulation breaks even with half the dt.
        Cancelled: when the user asked to stop.
    """
    if model.axes is not None:
        A = model.axes
        v0, C0 = (None if given is None else given @ A for given in (changes.v0, changes.C0))
        turned = Changes(changes.coefficients @ A, v0, None if C0 is None else A.T @ C0)
        x, changed = tangents(model.upright(), start.turned(A), phi, dphi, coefficients @ A, turned, progress, journal)
        return x @ A.T, changed @ A.T.astype(np.float32)
    device.start(model.device)
    return _Carrier(model, start, phi, dphi, changes, progress).run(coefficients, journal)


class _Carrier:
    """One body, its changes in groups that are carried together, a frame at a time."""

    def __init__(self, model: Model, start: State, phi: np.ndarray, dphi: np.ndarray, changes: Changes, progress: Progress) -> None:
        check_state(model.particles, model.offset, model.dx, start.x, start.v, start.C, start.F)
        self.model, self.state, self.progress = model, start, progress
        self.phi, self.dphi = torch.from_numpy(np.ascontiguousarray(phi)), torch.from_numpy(np.ascontiguousarray(dphi))
        count, n = len(changes.coefficients), model.particles
        # Few changes are spread over the cores rather than over the lanes.
        self.width = next((width for width in WIDTHS if count <= 2 * width), WIDTHS[-1])
        groups = -(-count // self.width)
        acting = (changes.coefficients != 0.0).any(axis=(2, 3))
        begin = np.where(acting.any(axis=1), acting.argmax(axis=1), acting.shape[1])
        for values in (changes.v0, changes.C0):
            if values is not None:
                begin[(values != 0.0).reshape(count, -1).any(axis=1)] = 0
        self.order = np.argsort(begin, kind="stable")
        self.begin = begin[self.order]
        """First acting frame of each change; later ones lie in later groups."""
        per_frame = torch.from_numpy(changes.coefficients[self.order]).float()
        self.coefficients = torch.cat([per_frame, per_frame.new_zeros(groups * self.width - count, *per_frame.shape[1:])])
        self.lanes = aligned_zeros((groups, n, STATE, self.width), np.float32)
        for rows, values in ((slice(0, 3), changes.v0), (slice(3, 12), changes.C0)):
            if values is not None:
                padded = np.zeros((groups * self.width, n, rows.stop - rows.start), np.float32)
                padded[:count] = values[self.order].reshape(count, n, -1)
                self.lanes[:, :, rows] = padded.reshape(groups, self.width, n, -1).transpose(0, 2, 3, 1)
        self.count, self.capacity, self.substeps = count, 0, 0
        self.source = aligned((groups, n, SOURCE, self.width), np.float32)

    def run(self, coefficients: np.ndarray, journal: Journal) -> tuple[np.ndarray, np.ndarray]:
        """Frame by frame under coefficients (T, P, 3) [m/s²]: what `tangents` returns, and what it raises."""
        frames, n = len(coefficients), self.model.particles
        x = np.empty((frames + 1, n, 3))
        changed = np.zeros((self.count, frames + 1, n, 3), np.float32)
        x[0] = self.state.x
        loop = journal.loop("frames", coefficients)
        done, kept = loop.resume()
        if done:
            x[: done + 1], changed[:, : done + 1], self.lanes[: len(kept["lanes"])] = kept["x"], kept["changed"], kept["lanes"]
            self.state = State(x[done].copy(), kept["v"], kept["C"], kept["F"])
        for t in range(done, frames):
            self.progress.check()
            acceleration = self.phi.numpy() @ coefficients[t] + self.model.gravity_in(t)
            spatial = np.linalg.inv(self.state.F)
            gradient = coefficients[t].T @ self.dphi.numpy() @ spatial
            substeps = self._record(acceleration, gradient, t)
            groups = -(-int((self.begin <= t).sum()) // self.width)
            if groups:
                self._force(groups, t, substeps, spatial)
                self._carry(groups, substeps)
                moved = self.lanes[:groups, :, 21:].transpose(0, 3, 1, 2).reshape(-1, n, 3)[: self.count]
                changed[self.order[: len(moved)], t + 1] = moved
            x[t + 1] = self.state.x
            loop.reached(t + 1, partial(self._so_far, x[: t + 2], changed[:, : t + 2], groups))
        return x, changed

    def _so_far(self, x: np.ndarray, changed: np.ndarray, groups: int) -> dict[str, np.ndarray]:
        """All that the next frame follows from; groups that have not begun are as they were made."""
        state = self.state
        return {"x": x, "changed": changed, "v": state.v, "C": state.C, "F": state.F, "lanes": self.lanes[:groups]}

    def _record(self, acceleration: np.ndarray, gradient: np.ndarray, frame: int) -> int:
        """The frame's substeps, kept and linearised; moves the body on. Returns their number: the model's, or twice that."""
        m = self.model
        for substeps in (m.substeps, 2 * m.substeps):
            status = self._attempt(acceleration, gradient, substeps)
            if status[0] == substep.RUNNING:
                break
        else:
            at = int(status[2]) + (status[0] != substep.BURST)
            found = diagnosis(int(status[0]), m.frame_dt / substeps / m.dx, self.x[at], self.v[at], self.F[at])
            raise failure((*found, int(status[2])), frame, substeps)
        with contracted():
            tangent_kernels.linearise(
                m.volume, m.mu, m.lam, m.viscosity, m.law, m.offset, m.dx, m.frame_dt / substeps,
                self.x, self.C, self.F, self.boxes, self.corner, self.record,
            )  # fmt: skip
        self.state = State(self.x[-1].copy(), self.v[-1].copy(), self.C[-1].copy(), self.F[-1].copy())
        return substeps

    def _attempt(self, acceleration: np.ndarray, gradient: np.ndarray, substeps: int) -> np.ndarray:
        m, n = self.model, self.model.particles
        if not self.capacity:
            self.capacity = int(min(np.prod(np.ceil(np.ptp(self.state.x, axis=0) / m.dx) + 4) * 1.5, self._most_nodes(substeps)))
        if substeps != self.substeps:  # memory that is used again need not be fetched from the system again
            self.substeps = substeps
            self.x, self.v = np.empty((substeps + 1, n, 3)), np.empty((substeps + 1, n, 3))
            self.C, self.F = np.empty((substeps + 1, n, 3, 3)), np.empty((substeps + 1, n, 3, 3))
            self.boxes, self.corner = np.zeros((substeps, 6), np.int32), np.zeros((substeps, n), np.int32)
            self.record = np.empty(substeps * n * RECORD, np.float32)
            self._make_room()
        while True:
            self.x[0], self.v[0], self.C[0], self.F[0] = self.state.x, self.state.v, self.state.C, self.state.F
            status = np.zeros(4, np.int32)
            tangent_kernels.record_frame(
                m.plastic, m.mass, m.volume, m.mu, m.lam, m.yield_stress, m.viscosity, m.law, m.role, m.clamp_lo, m.clamp,
                m.offset, m.dx, m.frame_dt / substeps, acceleration[None], gradient[None], LEAST_MASS * float(m.mass.min()),
                self.x, self.v, self.C, self.F, self.boxes, self.inverse_mass, self.grid, status,
            )  # fmt: skip
            if status[0] != substep.GRID_FULL:
                return status
            most = self._most_nodes(substeps)
            if status[3] > most:
                status[0] = substep.BURST
                return status
            self.capacity = min(int(status[3]) * 4 // 3, most)
            self._make_room()

    def _most_nodes(self, substeps: int) -> int:
        """Of a grid, so that neither the masses of a frame nor the columns of two groups are more than `MOST_NUMBERS`."""
        return max(MOST_NUMBERS // max(substeps, 2 * 3 * self.width), 1)

    def _make_room(self) -> None:
        """For `capacity` nodes and `substeps`."""
        self.inverse_mass = np.empty((self.substeps, self.capacity), np.float32)
        self.grid = np.empty((1, self.capacity, 4))

    def _force(self, groups: int, frame: int, substeps: int, spatial: np.ndarray) -> None:
        """What the changed force gives in a substep, into `source`; `spatial` (N, 3, 3) is F^-1 at the frame's start."""
        m, n = self.model, self.model.particles
        momentum = torch.from_numpy(m.mass * m.frame_dt / substeps)
        slope = m.dx * torch.from_numpy(spatial).transpose(1, 2) @ self.dphi.transpose(1, 2)
        given = (momentum[:, None, None] * torch.cat([self.phi[:, None], slope], dim=1)).float().reshape(4 * n, -1)
        change = self.coefficients[: groups * self.width, frame].reshape(groups, self.width, -1, 3).permute(0, 2, 3, 1)
        out = torch.from_numpy(self.source)[:groups].view(groups, 4 * n, 3 * self.width)
        torch.matmul(given, change.reshape(groups, -1, 3 * self.width), out=out)

    def _carry(self, groups: int, substeps: int) -> None:
        m, nodes = self.model, 3 * self.capacity
        mass, flat = m.mass.astype(np.float32), lambda array: array.reshape(-1, self.width)
        viscous = -4.0 * m.frame_dt / substeps / m.dx * m.volume * m.viscosity
        damping = np.stack([viscous, viscous * m.lam / m.mu], axis=1).astype(np.float32).reshape(-1)
        at_once = max(1, min(groups, _WORK_PER_CALL // (m.particles * substeps * self.width), MOST_NUMBERS // (nodes * self.width) - 1))
        at_once += at_once % 2
        for first in range(0, groups, at_once):
            grid = aligned((min(at_once, groups - first) * nodes, self.width), np.float32)
            self.progress.check()
            with native_vectors(), contracted(), compiled_in(np.float32):
                tangent_kernels.carry[self.width](
                    first, mass, damping, m.role, m.dx, m.frame_dt / substeps, self.boxes, self.corner, self.record, self.inverse_mass,
                    flat(self.source), flat(self.lanes), grid,
                )  # fmt: skip
