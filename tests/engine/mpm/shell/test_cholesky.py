"""Factors by nested dissection against a dense solve."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from seeing_wind.engine.mpm.shell.blas import one_thread
from seeing_wind.engine.mpm.shell.cholesky import BlockCholesky


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


@pytest.mark.parametrize("columns", [2, 9, 24])
def test_factors_solve(make, columns):
    plan, blocks, dense = problem(make, columns)
    right = np.random.default_rng(6).normal(size=(len(dense) // 3, 3))
    solution = plan.factor(blocks).solve(right)
    np.testing.assert_allclose(dense @ solution.ravel(), right.ravel(), atol=1e-10)
    assert (plan.slots(*plan.pairs.T) == np.arange(len(plan.pairs))).all()
    assert sorted(plan.order) == list(range(len(dense) // 3))


def test_a_matrix_that_is_not_positive_definite_is_refused(make):
    plan, blocks, _ = problem(make, 9)
    blocks[plan.pairs[:, 0] == plan.pairs[:, 1]] *= -1.0
    with pytest.raises(np.linalg.LinAlgError, match="vertex"):
        plan.factor(blocks)


def test_the_number_of_threads_comes_back():
    from seeing_wind.engine.mpm.shell.blas import _controls

    before = [get() for get, _ in _controls()]
    with one_thread():
        assert all(get() == 1 for get, _ in _controls())
    assert [get() for get, _ in _controls()] == before
