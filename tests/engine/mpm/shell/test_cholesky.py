"""Factors by nested dissection against a dense solve."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from seeing_wind.engine.mpm.shell.linear import fronts
from seeing_wind.engine.mpm.shell.linear.cholesky import BlockCholesky


def problem(make, columns):
    """A positive definite matrix on a mesh's pattern: its plan, blocks, and itself (3 V, 3 V)."""
    x, faces = make["irregular"](1.0, 0.7, columns, columns)
    count = len(x)
    rows, others = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
    plan = BlockCholesky(csr_array((np.ones(len(rows)), (rows, others)), shape=(count, count)), x)
    rng = np.random.default_rng(5)
    blocks = rng.normal(size=(len(plan.pairs), 3, 3))
    alone = plan.pairs[:, 0] == plan.pairs[:, 1]
    blocks[alone] = blocks[alone] + blocks[alone].transpose(0, 2, 1) + 40.0 * np.eye(3)
    dense = np.zeros((count, 3, count, 3))
    for (i, j), block in zip(plan.pairs, blocks):
        dense[i, :, j, :], dense[j, :, i, :] = block, block.T
    return plan, blocks, dense.reshape(3 * count, 3 * count)


@pytest.mark.parametrize(("columns", "shared"), [(2, False), (9, False), (24, False), (24, True)])
def test_factors_solve(make, monkeypatch, columns, shared):
    """On one thread, and with parts of the mesh shared out."""
    if shared:
        monkeypatch.setattr(fronts, "SMALL", 0)
    plan, blocks, dense = problem(make, columns)
    assert len(plan.fronts.levels) == (1 + fronts.DEPTH if shared else 1)
    right = np.random.default_rng(6).normal(size=(len(dense) // 3, 3))
    expected = np.linalg.solve(dense, right.ravel()).reshape(-1, 3)
    np.testing.assert_allclose(plan.factor(blocks).solve(right), expected, atol=1e-12)
    np.testing.assert_allclose(plan.factor(blocks.astype(np.float32)).solve(right), expected, atol=1e-6)
    assert (plan.slots(*plan.pairs.T) == np.arange(len(plan.pairs))).all()
    assert sorted(plan.order) == list(range(len(dense) // 3))


def test_the_same_matrix_gives_the_same_factors_every_time(make, monkeypatch):
    """Whichever thread does what: no sum may depend on who comes first."""
    monkeypatch.setattr(fronts, "SMALL", 0)
    plan, blocks, dense = problem(make, 24)
    right = np.random.default_rng(6).normal(size=(len(dense) // 3, 3))
    first = plan.factor(blocks).solve(right)
    for _ in range(20):
        assert (plan.factor(blocks).solve(right) == first).all()


@pytest.mark.parametrize("real", [np.float32, np.float64])
def test_a_matrix_that_is_not_positive_definite_is_refused(make, real):
    plan, blocks, dense = problem(make, 9)
    right = np.ones((len(dense) // 3, 3))
    whole = plan.factor(blocks.astype(real)).solve(right)
    alone = np.flatnonzero(plan.pairs[:, 0] == plan.pairs[:, 1])
    for wrong in alone[0], alone[-1]:
        bad = blocks.astype(real)
        bad[wrong] *= -1.0
        with pytest.raises(np.linalg.LinAlgError, match="not positive definite at vertex"):
            plan.factor(bad)
    bad[alone[3], 1, 1] = np.nan
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        plan.factor(bad)
    assert (plan.factor(blocks.astype(real)).solve(right) == whole).all()
