"""How the motion of a body changes with the force on it and with its start: many changes at once, to first order.

One simulation of the body as it is; then every change costs a small part of another, because it shares all that depends on the body alone
(`kernels.linearise`, `kernels.carry`): elastic or plastic, held by what stands still or by what moves. What touches
a collider has no such changes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import torch

from ..errors import SimulationError, UsageError
from ..progress import Journal, Progress
from .body.copies_run import CopiesRun, ends_of
from .body.frame_run import Piece
from .checks import check_state
from .compiler.settings import compiled_in, contracted, native_vectors
from .failure import diagnosis, failure
from .kernels import linearise, substep
from .kernels.carry import SOURCE, STATE, WIDTHS, carry
from .kernels.copies_forward import CODE, DONE
from .kernels.linearise import FLOW
from .kernels.native import aligned, aligned_zeros
from .lattice.kinematics import conditions_for
from .laws.plasticity import VON_MISES
from .model import Model
from .state import State

LEAST_MASS = 1e-12
"""Nodes with less than this share of the lightest particle's mass do not move: a particle on the edge between two cells gives the far node
of one a weight that is rounding, and its inverse is beyond single precision."""
MOST_NUMBERS = 2**29
"""In any one array: kernels index with 32 bits, and 2 GB is more than any body asks for that has not flown apart."""
FLOWN, BESIDE = 2.0, 5.0
"""Times its diagonal at the start, and nodes beside it, that the grid of an elastic body may be long in all three directions. One that
needs more has flown apart: what is carried along says nothing then, and costs as many times more as the grid has grown."""
_WORK_PER_CALL = 6_000_000
"""Changes of a particle in a substep between two safe points."""


@dataclass(frozen=True)
class Changes:
    """Changes in B directions, by the frame from which on a direction acts."""

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
        start: the body at the first frame.
        phi, dphi: (N, P) basis at the particles' rest positions, (N, P, 3) its gradient [1/m]; the force is as in `rollout_batch`.
        coefficients: (T, P, 3) [m/s²].
        changes: directions.
        journal: keeps how far the frames have come.

    Returns:
        positions (T+1, N, 3) [m], and their changes (B, T+1, N, 3) [m], single precision.

    Raises:
        SimulationError: when the simulation breaks even with half the dt.
        UsageError: for a model with colliders.
        Cancelled: when the user asked to stop.
    """
    if model.movers or model.collider_grid.active:
        raise UsageError("Changes of a motion are not carried past colliders.", "Leave the colliders out.")
    if model.axes is not None:
        A = model.axes
        v0, C0 = (None if given is None else given @ A for given in (changes.v0, changes.C0))
        turned = Changes(changes.coefficients @ A, v0, None if C0 is None else A.T @ C0)
        x, changed = tangents(model.upright(), start.turned(A), phi, dphi, coefficients @ A, turned, progress, journal)
        return x @ A.T, changed @ A.T.astype(np.float32)
    return _Carrier(model, start, phi, dphi, changes, progress).run(coefficients, journal)


class _Carrier:
    """One body, its changes in groups that are carried together, a frame at a time."""

    def __init__(self, model: Model, start: State, phi: np.ndarray, dphi: np.ndarray, changes: Changes, progress: Progress) -> None:
        check_state(model.particles, model.offset, model.dx, start.x, start.v, start.C, start.F)
        self.model, self.state, self.progress = model, start, progress
        longest = np.inf if model.plastic else FLOWN * np.linalg.norm(np.ptp(start.x, axis=0)) / model.dx + BESIDE
        self.body = CopiesRun(model, int(min(MOST_NUMBERS // (2 * 4 * WIDTHS[-1]), longest**3)))
        self.body.make_room_for(start.x[None])
        self.active, self.count = self.body.packing.active, len(self.body.packing.active)
        self.phi, self.dphi = torch.from_numpy(np.ascontiguousarray(phi)), torch.from_numpy(np.ascontiguousarray(dphi))
        count, n = len(changes.coefficients), self.count
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
                padded[:count] = values[self.order][:, self.active].reshape(count, n, -1)
                self.lanes[:, :, rows] = padded.reshape(groups, self.width, n, -1).transpose(0, 2, 3, 1)
        self.changes, self.boxes = count, np.zeros((0, 6), np.int32)
        self.source = aligned((groups, n, SOURCE, self.width), np.float32)

    def run(self, coefficients: np.ndarray, journal: Journal) -> tuple[np.ndarray, np.ndarray]:
        """Frame by frame under coefficients (T, P, 3) [m/s²]: what `tangents` returns, and what it raises."""
        frames, n = len(coefficients), self.model.particles
        x = np.empty((frames + 1, n, 3))
        changed = np.zeros((self.changes, frames + 1, n, 3), np.float32)
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
                self._force(groups, t, substeps, gradient[self.active], spatial[self.active])
                self._carry(groups, substeps)
                moved = self.lanes[:groups, :, 21:].transpose(0, 3, 1, 2).reshape(-1, self.count, 3)[: self.changes]
                changed[self.order[: len(moved), None], t + 1, self.active] = moved
            x[t + 1] = self.state.x
            loop.reached(t + 1, partial(self._so_far, x[: t + 2], changed[:, : t + 2], groups))
        return x, changed

    def _so_far(self, x: np.ndarray, changed: np.ndarray, groups: int) -> dict[str, np.ndarray]:
        """All that the next frame follows from; groups that have not begun are as they were made."""
        state = self.state
        return {"x": x, "changed": changed, "v": state.v, "C": state.C, "F": state.F, "lanes": self.lanes[:groups]}

    def _record(self, acceleration: np.ndarray, gradient: np.ndarray, frame: int) -> int:
        """The frame's substeps, kept and linearised; moves the body on. Returns their number: the model's, or twice that."""
        m, packing = self.model, self.body.packing
        conditions = conditions_for(m, frame, self.state)
        force = packing.forces(packing.active, acceleration, gradient)
        for substeps in (m.substeps, 2 * m.substeps):
            self._make_room(substeps)
            pieces = [packing.piece(c, packing.active, m.frame_dt / substeps) for c in conditions]
            self.rows[: 6 * self.count] = packing.packed(packing.active, self.state, m.offset)
            status = self.body.frame(self.rows, force, 1, pieces, substeps, self.progress, self.boxes)[0]
            if status[CODE] == substep.RUNNING:
                break
        else:
            raise self._failure(status, frame, substeps)
        self._linearise(pieces, force)
        after = State(*(np.array(array) for array in (self.state.x, self.state.v, self.state.C, self.state.F)))
        packing.write(packing.active, self.rows[-6 * self.count :], m.offset, after)
        self.state = after
        return substeps

    def _failure(self, status: np.ndarray, frame: int, substeps: int) -> SimulationError:
        """The error for a frame that broke in both lengths of substeps."""
        at = int(status[DONE]) + (status[CODE] != substep.BURST)
        columns = self.rows.reshape(-1, self.count, 2, 3, 4)[at]  # of F with x, of C with v
        F, (x, v) = columns[:, 0, :, :3].swapaxes(1, 2), (columns[:, k, :, 3] for k in (0, 1))
        code, worst = diagnosis(int(status[CODE]), self.model.frame_dt / substeps / self.model.dx, x, v, F)
        return failure((code, int(self.body.packing.active[worst]), int(status[DONE])), frame, substeps)

    def _make_room(self, substeps: int) -> None:
        """For all that is kept of a frame; memory that is used again need not be fetched from the system again."""
        if substeps == len(self.boxes):
            return
        count, flowing = self.count, self.model.plastic
        self.rows = aligned(((substeps + 1) * 6 * count, 4), np.float64)
        self.boxes, self.corner = np.zeros((substeps, 6), np.int32), np.zeros((substeps, count), np.int32)
        self.record = np.empty(substeps * count * linearise.width_of(flowing), np.float32)
        self.flows = np.zeros((substeps, count) if flowing else (1, 1), np.int32)
        self.flow = np.empty(substeps * count * FLOW if flowing else 1, np.float32)

    def _linearise(self, pieces: list[Piece], force: np.ndarray) -> None:
        """Fills corner, record, flows, flow, inverse_mass and velocity from what the frame has kept."""
        m, substeps, begin = self.model, len(self.boxes), 0
        self.nodes = int(np.prod(self.boxes[:, 3:].astype(np.int64), axis=1).max())
        self.inverse_mass = np.empty((substeps, self.nodes), np.float32)
        self.velocity = np.empty(3 * substeps * self.nodes, np.float32)
        for piece, end in zip(pieces, ends_of(len(pieces), substeps)):
            bounds = np.concatenate([np.zeros(3 * substep.CLAMP_LO, np.int32), piece.lo])
            with contracted(), compiled_in(np.float64):
                linearise.node_motion(
                    begin, end, self.body.capacity, LEAST_MASS * float(m.mass.min()), self.boxes, self.body.grid,
                    *piece.boundary, piece.lattice, bounds, self.inverse_mass, self.velocity,
                )  # fmt: skip
                linearise.linearise(
                    m.plastic, begin, end, self.nodes, self.body.particle, self.rows, force, piece.lattice, self.boxes, self.velocity,
                    self.corner, self.record, self.flows, self.flow,
                )  # fmt: skip
            begin = end

    def _force(self, groups: int, frame: int, substeps: int, gradient: np.ndarray, spatial: np.ndarray) -> None:
        """What the changed force gives in a substep, into `source`; `spatial` (M, 3, 3) is F^-1 at the frame's start.

        `gradient` (M, 3, 3), grad a, changes with F itself by -grad a dF F^-1; nodes that go along undo just that.
        """
        m, n = self.model, self.count
        momentum = torch.from_numpy(m.mass[self.active] * m.frame_dt / substeps)
        slope = m.dx * torch.from_numpy(spatial).transpose(1, 2) @ self.dphi[self.active].transpose(1, 2)
        given = (momentum[:, None, None] * torch.cat([self.phi[self.active][:, None], slope], dim=1)).float().reshape(4 * n, -1)
        change = self.coefficients[: groups * self.width, frame].reshape(groups, self.width, -1, 3).permute(0, 2, 3, 1)
        out = torch.from_numpy(self.source)[:groups].view(groups, 4 * n, 3 * self.width)
        torch.matmul(given, change.reshape(groups, -1, 3 * self.width), out=out)
        if not m.plastic:
            return
        scaled = torch.from_numpy(-m.dx * gradient).float() * momentum[:, None, None].float()
        dF = torch.from_numpy(self.lanes)[:groups, :, 12:21].unflatten(2, (3, 3))
        turned = torch.einsum("nca,gnabw,nbk->gnkcw", scaled, dF, torch.from_numpy(spatial).float())
        torch.from_numpy(self.source)[:groups, :, 3:] += turned.flatten(2, 3)

    def _carry(self, groups: int, substeps: int) -> None:
        m, nodes, active = self.model, 4 * self.nodes, self.active
        mass, flat = m.mass[active].astype(np.float32), lambda array: array.reshape(-1, self.width)
        viscous = np.where(m.law < VON_MISES, -4.0 * m.frame_dt / substeps / m.dx * m.volume * m.viscosity, 0.0)[active]
        damping = np.stack([viscous, viscous * m.lam[active] / m.mu[active]], axis=1).astype(np.float32).reshape(-1)
        at_once = max(1, min(groups, _WORK_PER_CALL // (self.count * substeps * self.width), MOST_NUMBERS // (nodes * self.width) - 1))
        at_once += at_once % 2
        for first in range(0, groups, at_once):
            grid = aligned((min(at_once, groups - first) * nodes, self.width), np.float32)
            self.progress.check()
            with native_vectors(), contracted(), compiled_in(np.float32):
                carry[self.width](
                    m.plastic, first, mass, damping, m.role[active], m.dx, m.frame_dt / substeps, self.boxes,
                    self.corner, self.record, self.flows, self.flow, self.inverse_mass, self.velocity,
                    flat(self.source), flat(self.lanes), grid,
                )  # fmt: skip
