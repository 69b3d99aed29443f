"""The linear equations of a Newton iteration, whichever factors stand before them."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.errors import SimulationError
from seeing_wind.engine.materials import SHEETS
from seeing_wind.engine.mpm.shell import advance, advance_frame, at_rest, shell_of
from seeing_wind.engine.mpm.shell import substep as room
from seeing_wind.engine.mpm.shell.linear import Unfinished, system


def matrix_of(shell, y, inertia):
    faces = shell.forces.faces(y)
    tangents = shell.forces.tangents(faces.F, faces.stress, 0.0)
    return shell.system.matrix(faces.F, tangents, np.broadcast_to(inertia * np.eye(3), (len(y), 3, 3)), 1.0)


@pytest.mark.parametrize(("inertia", "precision"), [(10.0, np.float32), (1e-2, np.float64)])
def test_the_equations_are_solved_and_few_iterations_are_enough(make, inertia, precision):
    """Heavy vertices (a short substep): single precision, faces alone. Light ones: both faces of each edge. Inertia in N/m."""
    x, faces = make["irregular"](0.16, 0.16, 16, 16)
    pinned = x[:, 0] < 1e-9
    shell = shell_of(x, faces, SHEETS["cotton"], pinned=pinned)
    rng = np.random.default_rng(7)
    matrix = matrix_of(shell, x + 1e-5 * rng.normal(size=x.shape), inertia)
    factors = matrix.factors()
    assert factors.precision == precision
    right = np.where(pinned[:, None], 0.0, rng.normal(size=x.shape))
    found, count = matrix.solve(right, factors, 1e-9)
    np.testing.assert_allclose(matrix.times(found), right, atol=1e-5 * np.abs(right).max())
    assert (found[pinned] == 0.0).all()
    assert matrix.solve(right, factors, 0.1)[1] <= 8 and count < 80


def hanging(make):
    x, faces = make["grid"](0.2, 0.2, 6, 6)
    return shell_of(x, faces, SHEETS["cotton"], pinned=x[:, 0] < 1e-9)


def test_too_few_iterations_are_said(make):
    """The way so far comes with the error, and going on from there leads to the solution."""
    shell = hanging(make)
    matrix = matrix_of(shell, shell.surface.x, 1.0)
    factors = matrix.factors()
    right = np.where(shell.pinned[:, None], 0.0, np.random.default_rng(9).normal(size=shell.surface.x.shape))
    with pytest.raises(Unfinished, match="after 2 iterations") as caught:
        matrix.solve(right, factors, 1e-9, most=2)
    rest, _ = matrix.solve(right - matrix.times(caught.value.x), factors, 1e-9)
    np.testing.assert_allclose(matrix.times(caught.value.x + rest), right, atol=1e-6)


def test_a_substep_whose_equations_are_not_solved_is_halved_or_refused(make, monkeypatch):
    shell, gravity, substeps = hanging(make), np.array([0.0, 0.0, -9.81]), 7
    start = at_rest(shell, acceleration=np.broadcast_to(gravity, shell.surface.x.shape), dt=1.0 / 24.0 / substeps)
    solved, seen = system.Matrix.solve, []

    def frame():
        return advance_frame(shell, start, frame=0, fps=24.0, substeps=substeps, gravity=gravity)

    def once_unfinished(self, right, factors, tolerance, most=system.MOST):
        seen.append(most)
        return solved(self, right, factors, tolerance, 1 if len(seen) == 1 else most)

    expected = frame().x
    monkeypatch.setattr(system.Matrix, "solve", lambda *given: solved(*given[:4], 1))
    with pytest.raises(SimulationError, match="after 1 iterations"):
        advance(shell, start, dt=0.006, gravity=gravity)
    with pytest.raises(SimulationError, match="after 1 iterations"):
        frame()
    lengths, whole = [], room.equations_of
    monkeypatch.setattr(room, "equations_of", lambda shell, state, dt, *rest: lengths.append(dt) or whole(shell, state, dt, *rest))
    monkeypatch.setattr(system.Matrix, "solve", once_unfinished)
    assert np.abs(frame().x - expected).max() < 0.01 * np.abs(expected - start.x).max()
    assert lengths[1:3] == [0.5 * lengths[0]] * 2 and len(lengths) == substeps + 2
