"""How the motion of a body changes with the force on it and with its start: many changes at once, to first order.

The body is simulated once as it is. Every change then costs a small fraction of a simulation, because all changes share what depends on
the body alone (`kernels.linearise`, `kernels.carry`). The body may be elastic or plastic, and its pins may move, but it must not touch a
collider. Where there are many changes, a few mixtures of them are carried instead (`body.columns`).
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
"""Nodes with less than this share of the lightest particle's mass do not move: a particle on the border of two cells gives the farthest
node of one of them a weight that is a rounding error, and its inverse is beyond single precision."""
MOST_NUMBERS = 2**29
"""Most numbers in any one array: kernels index with 32 bits, and no body needs more than 2 GB unless it has flown apart."""
FLOWN, BESIDE = 2.0, 5.0
"""The grid of an elastic body may have as many nodes as a cube with a side of this many diagonals of the body at its start, plus this many
nodes. A body that needs more has flown apart: its changes then mean nothing, and their cost grows with the grid."""
_WORK_PER_CALL = 6_000_000
"""Changes times particles times substeps between two safe points."""


@dataclass(frozen=True)
class Changes:
    """Changes of the force and of the start in B directions.

    They should be of comparable size: an effect of one direction that is a hundred thousandth of the effect of all may be lost.
    """

    coefficients: np.ndarray
    """(B, T, P, 3) changes of the force's coefficients [m/s²]; zero before the direction's first frame."""
    v0: np.ndarray | None = None
    """(B, N, 3) changes of the initial velocities [m/s]."""
    C0: np.ndarray | None = None
    """(B, N, 3, 3) changes of the initial affine velocities [1/s]."""


Wanted = Callable[[int, np.ndarray, np.ndarray], np.ndarray]
"""Computes the changes that are wanted: (frame, x (N, 3), changes of x (columns, N, 3)) -> (columns, ...), linear in the changes of x."""


def positions(frame: int, x: np.ndarray, changes: np.ndarray) -> np.ndarray:
    """A `Wanted`: the changes of the positions themselves."""
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
    """The motion under a force, and its first-order changes.

    Args:
        phi, dphi: (N, P) basis at the particles' rest positions, (N, P, 3) its gradient [1/m]; the force is as in `rollout_batch`.
        coefficients: (T, P, 3) [m/s²].
        journal: keeps the frames done so far.
        wanted: called for each frame, and first for frame 0 with no changes, to find the shape of what it returns.

    Returns:
        positions (T+1, N, 3) [m], and the changes of the wanted quantity (B, T+1, ...), in single precision; zero in frame 0.

    Raises:
        SimulationError: when the simulation fails even with half the dt.
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
    """One body and its changes, advanced frame by frame."""

    def __init__(self, model: Model, start: State, phi: np.ndarray, dphi: np.ndarray, changes: Changes, progress: Progress) -> None:
        check_state(model.particles, model.offset, model.dx, start.x, start.v, start.C, start.F)
        self.model, self.state, self.progress = model, start, progress
        longest = np.inf if model.plastic else FLOWN * np.linalg.norm(np.ptp(start.x, axis=0)) / model.dx + BESIDE
        self.body = CopiesRun(model, int(min(MOST_NUMBERS // (2 * 4 * WIDTHS[-1]), longest**3)))
        self.body.make_room_for(start.x[None])
        self.active, self.count = self.body.packing.active, len(self.body.packing.active)
        self.phi, self.dphi = torch.from_numpy(np.ascontiguousarray(phi)), torch.from_numpy(np.ascontiguousarray(dphi))
        count = len(changes.coefficients)
        # A few changes are spread over the cores rather than over the lanes of one vector.
        width = next((width for width in WIDTHS if count <= 2 * width), WIDTHS[-1])
        self.coefficients = changes.coefficients.reshape(*changes.coefficients.shape[:2], -1)  # (B, T, 3 P)
        moves = ((VELOCITY, changes.v0), (SPIN, changes.C0))
        begin = [(part, values[:, self.active]) for part, values in moves if values is not None]
        self.columns = Columns(count, self.count, width, begin)
        self.boxes = np.zeros((0, 6), np.int32)

    def run(self, coefficients: np.ndarray, journal: Journal, wanted: Wanted) -> tuple[np.ndarray, np.ndarray]:
        """All frames under coefficients (T, P, 3) [m/s²]. Returns and raises as `tangents`."""
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
        """Everything that the next frame depends on, for the journal."""
        state = self.state
        return {"x": x, "changed": changed, "v": state.v, "C": state.C, "F": state.F, **self.columns.state()}

    def _record(self, acceleration: np.ndarray, gradient: np.ndarray, frame: int) -> int:
        """Advance the body by a frame, keep its substeps and linearise them. Returns their number: the model's, or twice that."""
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
        """The error for a frame that failed with either length of substeps."""
        at = int(status[DONE]) + (status[CODE] != substep.BURST)
        columns = self.rows.reshape(-1, self.count, 2, 3, 4)[at]  # of F with x, of C with v
        F, (x, v) = columns[:, 0, :, :3].swapaxes(1, 2), (columns[:, k, :, 3] for k in (0, 1))
        code, worst = diagnosis(int(status[CODE]), self.model.frame_dt / substeps / self.model.dx, x, v, F)
        return failure((code, int(self.body.packing.active[worst]), int(status[DONE])), frame, substeps)

    def _make_room(self, substeps: int) -> None:
        """Allocate what is kept of a frame; memory of the same size is reused, which saves getting it from the system again."""
        if substeps == len(self.boxes):
            return
        count, flowing = self.count, self.model.plastic
        self.rows = aligned(((substeps + 1) * 6 * count, 4), np.float64)
        self.boxes, self.corner = np.zeros((substeps, 6), np.int32), np.zeros((substeps, count), np.int32)
        self.record = np.empty(substeps * count * linearise.width_of(flowing), np.float32)
        self.flows = np.zeros((substeps, count) if flowing else (1, 1), np.int32)
        self.flow = np.empty(substeps * count * FLOW if flowing else 1, np.float32)

    def _linearise(self, pieces: list[Piece], force: np.ndarray) -> None:
        """Fill corner, record, flows, flow, inverse_mass and velocity from the frame's kept substeps."""
        m, substeps, begin, flowing = self.model, len(self.boxes), 0, self.model.plastic
        self.nodes = int(np.prod(self.boxes[:, 3:].astype(np.int64), axis=1).max())
        self.inverse_mass = np.empty((substeps, self.nodes), np.float32)
        self.velocity = np.empty(3 * substeps * self.nodes, np.float32)
        for piece, end in zip(pieces, ends_of(len(pieces), substeps)):
            bounds = np.concatenate([np.zeros(3 * substep.CLAMP_LO, np.int32), piece.lo])
            # `compiled_sooner` only pays for the long kernels of plastic laws; the others would take a twentieth longer to run.
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
        """The columns' sources in a substep, (groups, M, SOURCE, width), for changes `force` (columns, 3 P) of the coefficients; `spatial`
        (M, 3, 3) is F^-1 at the frame's start.

        `gradient` (M, 3, 3), grad a, also changes with F, by -grad a dF F^-1; in an elastic body, nodes that move along cancel just that.
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
