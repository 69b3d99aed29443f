"""The linear equations of a Newton iteration, whichever factors stand before them."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.materials import SHEETS
from seeing_wind.engine.mpm.shell import membrane as stretch
from seeing_wind.engine.mpm.shell import shell_of


@pytest.mark.parametrize(("inertia", "precision"), [(10.0, np.float32), (1e-2, np.float64)])
def test_the_equations_are_solved_and_few_iterations_are_enough(make, inertia, precision):
    """Heavy vertices (a short substep): single precision, faces alone. Light ones: both faces of each edge. Inertia in N/m."""
    x, faces = make["irregular"](0.16, 0.16, 16, 16)
    pinned = x[:, 0] < 1e-9
    shell = shell_of(x, faces, SHEETS["cotton"], pinned=pinned)
    rng = np.random.default_rng(7)
    F = stretch.deformation(shell.membrane, x + 1e-5 * rng.normal(size=x.shape))
    E = stretch.strain(F)
    blocks = stretch.hessian(shell.membrane, F, stretch.stress(shell.membrane, E), stretch.stress_tangent(shell.membrane, E))
    matrix = shell.system.matrix(blocks, np.broadcast_to(inertia * np.eye(3), (len(x), 3, 3)), 1.0)
    factors = matrix.factors()
    assert factors.precision == precision
    right = np.where(pinned[:, None], 0.0, rng.normal(size=x.shape))
    found, count = matrix.solved(right, factors, 1e-9)
    np.testing.assert_allclose(matrix.times(found), right, atol=1e-5 * np.abs(right).max())
    assert (found[pinned] == 0.0).all()
    assert matrix.solved(right, factors, 0.1)[1] <= 8 and count < 80
