"""How the motion of a body changes with the force on it and with its start: many changes at once, to first order.

One simulation of the body as it is; then every change costs a small part of another, because it shares all that depends on the body alone
(`kernels.linearise`, `kernels.carry`): elastic or plastic, held by what stands still or by what moves. What touches
a collider has no such changes. Where there are many changes, a few mixtures of them are carried instead (`body.columns`).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch

from ..errors import SimulationError, UsageError
from ..progress import Journal, Progress
from .body.columns import PLACE, SPIN, VELOCITY, Columns
from .body.copies_run import CopiesRun, ends_of
from .body.frame_run import Piece
from .checks import check_state
from .compiler.settings import compiled_in, compiled_sooner, contracted, native_vectors
from .failure import diagnosis, failure
from .kernels import linearise, substep
from .kernels.carry import SOURCE, WIDTHS, carry
from .kernels.copies_forward import CODE, DONE
from .kernels.linearise import FLOW
from .kernels.native import aligned
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
    """Changes in B directions, by the frame from which on a direction acts.

    They should be of comparable size: of what a direction does, a hundred thousandth of what all do may be lost.
    """

    coefficients: np.ndarray
    """(B, T, P, 3) of the force's coefficients [m/s²]; zero before the direction's first frame."""
    v0: np.ndarray | None = None
    """(B, N, 3) of the initial velocities [m/s]."""
    C0: np.ndarray | None = None
    """(B, N, 3, 3) of the initial affine velocities [1/s]."""


Wanted = Callable[[int, np.ndarray, np.ndarray], np.ndarray]
"""What is wanted of changed positions: (frame, x (N, 3), changes (columns, N, 3)) -> (columns, ...), linear in the changes."""


def positions(frame: int, x: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """The changed positions themselves."""
    return changes


def tangents(
    model: Model,
    start: State,
    phi: np.ndarray,
    dphi: np.ndarray,
    coefficients: np.ndarray,
    changes: Changes,
    progress: Progress,
    journal: Journal = Journal(),
    wanted: Wanted = positions,
) -> tuple[np.ndarray, np.ndarray]:
    """Motion under a force, and how it changes to first order.

    Args:
        phi, dphi: (N, P) basis at the particles' rest positions, (N, P, 3) its gradient [1/m]; the force is as in `rollout_batch`.
        coefficients: (T, P, 3) [m/s²].
        journal: keeps how far the frames have come.
        wanted: of the changes in each frame; asked for frame 0 with no changes, too, which tells its shape.

    Returns:
        positions (T+1, N, 3) [m], and what is wanted of their changes (B, T+1, ...), single precision; zero in frame 0.

    Raises:
        SimulationError: when the simulation breaks even with half the dt.
        UsageError: for a model with colliders.
    """
    if model.movers or model.collider_grid.active:
        raise UsageError("Changes of a motion are not carried past colliders.", "Leave the colliders out.")
    if model.axes is not None:
        A = model.axes
        v0, C0 = (None if given is None else given @ A for given in (changes.v0, changes.C0))
        turned = Changes(changes.coefficients @ A, v0, None if C0 is None else A.T @ C0)

        def back(frame: int, x: np.ndarray, moved: np.ndarray) -> np.ndarray:
            return wanted(frame, x @ A.T, moved @ A.T.astype(np.float32))

        x, changed = tangents(model.upright(), start.turned(A), phi, dphi, coefficients @ A, turned, progress, journal, back)
        return x @ A.T, changed
    return _Carrier(model, start, phi, dphi, changes, progress).run(coefficients, journal, wanted)


class _Carrier:
    """One body and its changes, a frame at a time."""

    def __init__(self, model: Model, start: State, phi: np.ndarray, dphi: np.ndarray, changes: Changes, progress: Progress) -> None:
        check_state(model.particles, model.offset, model.dx, start.x, start.v, start.C, start.F)
        self.model, self.state, self.progress = model, start, progress
        longest = np.inf if model.plastic else FLOWN * np.linalg.norm(np.ptp(start.x, axis=0)) / model.dx + BESIDE
        self.body = CopiesRun(model, int(min(MOST_NUMBERS // (2 * 4 * WIDTHS[-1]), longest**3)))
        self.body.make_room_for(start.x[None])
        self.active, self.count = self.body.packing.active, len(self.body.packing.active)
        self.phi, self.dphi = torch.from_numpy(np.ascontiguousarray(phi)), torch.from_numpy(np.ascontiguousarray(dphi))
        count = len(changes.coefficients)
        # Few changes are spread over the cores rather than over the lanes.
        width = next((width for width in WIDTHS if count <= 2 * width), WIDTHS[-1])
        self.coefficients = changes.coefficients.reshape(*changes.coefficients.shape[:2], -1)  # (B, T, 3 P)
        moves = ((VELOCITY, changes.v0), (SPIN, changes.C0))
        begin = [(part, values[:, self.active]) for part, values in moves if values is not None]
        self.columns = Columns(count, self.count, width, begin)
        self.boxes = np.zeros((0, 6), np.int32)

    def run(self, coefficients: np.ndarray, journal: Journal, wanted: Wanted) -> tuple[np.ndarray, np.ndarray]:
        """Frame by frame under coefficients (T, P, 3) [m/s²]: what `tangents` returns, and what it raises."""
        frames, n = len(coefficients), self.model.particles
        x = np.empty((frames + 1, n, 3))
        x[0] = self.state.x
        none = np.zeros((0, n, 3), np.float32)
        changed = np.zeros((len(self.coefficients), frames + 1, *wanted(0, x[0], none).shape[1:]), np.float32)
        loop = journal.loop("frames", coefficients)
        done, kept = loop.resume()
        if done:
            x[: done + 1], changed[:, : done + 1] = kept["x"], kept["changed"]
            self.columns.resume(kept)
            self.state = State(x[done].copy(), kept["v"], kept["C"], kept["F"])
        for t in range(done, frames):
            self.progress.check()
            acceleration = self.phi.numpy() @ coefficients[t] + self.model.gravity_in(t)
            spatial = np.linalg.inv(self.state.F)
            gradient = coefficients[t].T @ self.dphi.numpy() @ spatial
            substeps = self._record(acceleration, gradient, t)
            force = self.columns.prepare_frame(self.coefficients[:, t], self.model.frame_dt)
            x[t + 1] = self.state.x
            if self.columns.count:
                self._carry(self._source(force, substeps, gradient[self.active], spatial[self.active]), substeps)
                moved = np.zeros((self.columns.count, n, 3), np.float32)
                moved[:, self.active] = self.columns.states(PLACE)
                found = wanted(t + 1, x[t + 1], moved)
                mixed = self.columns.mix.astype(np.float32) @ found.reshape(len(found), -1).astype(np.float32)
                changed[:, t + 1] = mixed.reshape(changed[:, t + 1].shape)
            loop.reached(t + 1, partial(self._so_far, x[: t + 2], changed[:, : t + 2]))
        return x, changed

    def _so_far(self, x: np.ndarray, changed: np.ndarray) -> dict[str, np.ndarray]:
        """All that the next frame follows from."""
        state = self.state
        return {"x": x, "changed": changed, "v": state.v, "C": state.C, "F": state.F, **self.columns.state()}

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
        m, substeps, begin, flowing = self.model, len(self.boxes), 0, self.model.plastic
        self.nodes = int(np.prod(self.boxes[:, 3:].astype(np.int64), axis=1).max())
        self.inverse_mass = np.empty((substeps, self.nodes), np.float32)
        self.velocity = np.empty(3 * substeps * self.nodes, np.float32)
        for piece, end in zip(pieces, ends_of(len(pieces), substeps)):
            bounds = np.concatenate([np.zeros(3 * substep.CLAMP_LO, np.int32), piece.lo])
            # Only what flows is so long that this is worth it; the rest would take a twentieth longer to run.
            with contracted(), compiled_sooner() if flowing else nullcontext(), compiled_in(np.float64):
                linearise.node_motion(
                    begin, end, self.body.capacity, LEAST_MASS * float(m.mass.min()), self.boxes, self.body.grid,
                    *piece.boundary, piece.lattice, bounds, self.inverse_mass, self.velocity,
                )  # fmt: skip
                linearise.linearise(
                    m.plastic, begin, end, self.nodes, self.body.particle, self.rows, force, piece.lattice, self.boxes, self.velocity,
                    self.corner, self.record, self.flows, self.flow,
                )  # fmt: skip
            begin = end

    def _source(self, force: np.ndarray, substeps: int, gradient: np.ndarray, spatial: np.ndarray) -> np.ndarray:
        """What the columns' force (columns, 3 P) gives in a substep, (groups, M, SOURCE, width); `spatial` (M, 3, 3) is F^-1 at the frame's
        start.

        `gradient` (M, 3, 3), grad a, changes with F itself by -grad a dF F^-1; nodes that go along undo just that.
        """
        m, n, (groups, width) = self.model, self.count, (len(self.columns.lanes), self.columns.width)
        momentum = torch.from_numpy(m.mass[self.active] * m.frame_dt / substeps)
        slope = m.dx * torch.from_numpy(spatial).transpose(1, 2) @ self.dphi[self.active].transpose(1, 2)
        given = (momentum[:, None, None] * torch.cat([self.phi[self.active][:, None], slope], dim=1)).float().reshape(4 * n, -1)
        padded = np.zeros((groups * width, force.shape[1]), np.float32)
        padded[: len(force)] = force
        change = torch.from_numpy(padded).reshape(groups, width, -1, 3).permute(0, 2, 3, 1)
        source = torch.from_numpy(aligned((groups, n, SOURCE, width), np.float32))
        torch.matmul(given, change.reshape(groups, -1, 3 * width), out=source.view(groups, 4 * n, 3 * width))
        if m.plastic:
            scaled = torch.from_numpy(-m.dx * gradient).float() * momentum[:, None, None].float()
            dF = torch.from_numpy(self.columns.lanes)[:, :, 12:21].unflatten(2, (3, 3))
            turned = torch.einsum("nca,gnabw,nbk->gnkcw", scaled, dF, torch.from_numpy(spatial).float())
            source[:, :, 3:] += turned.flatten(2, 3)
        return source.numpy()

    def _carry(self, source: np.ndarray, substeps: int) -> None:
        m, nodes, active, lanes = self.model, 4 * self.nodes, self.active, self.columns.lanes
        groups, width = len(lanes), self.columns.width
        mass, flat = m.mass[active].astype(np.float32), lambda array: array.reshape(-1, width)
        viscous = np.where(m.law < VON_MISES, -4.0 * m.frame_dt / substeps / m.dx * m.volume * m.viscosity, 0.0)[active]
        damping = np.stack([viscous, viscous * m.lam[active] / m.mu[active]], axis=1).astype(np.float32).reshape(-1)
        at_once = max(1, min(groups, _WORK_PER_CALL // (self.count * substeps * width), MOST_NUMBERS // (nodes * width) - 1))
        at_once += at_once % 2
        for first in range(0, groups, at_once):
            grid = aligned((min(at_once, groups - first) * nodes, width), np.float32)
            self.progress.check()
            with native_vectors(), contracted(), compiled_in(np.float32):
                carry[width](
                    m.plastic, first, mass, damping, m.role[active], m.dx, m.frame_dt / substeps, self.boxes,
                    self.corner, self.record, self.flows, self.flow, self.inverse_mass, self.velocity,
                    flat(source), flat(lanes), grid,
                )  # fmt: skip
