"""Phases of a kernel on several threads."""
# mypy: ignore-errors

import numpy as np
import pytest

from seeing_wind.engine.mpm.compiler import device, ti
from seeing_wind.engine.mpm.kernels.crew import await_all, counters, finish, roster, take
from seeing_wind.engine.mpm.kernels.substep import STRIDE

integers = ti.types.ndarray(dtype=ti.i32, ndim=1)


@ti.kernel
def neighbours_sum(workers: ti.i32, roster: counters, first: integers, second: integers, visits: integers):
    """first = task number, squared slowly; then second = sum of two neighbours of first, which other workers may have written."""
    ti.loop_config(block_dim=STRIDE)
    for turn in range(workers * STRIDE):
        if turn % STRIDE == 0:
            worker, tasks = turn // STRIDE, first.shape[0]
            task = take(roster, 0, worker, workers, tasks)
            while task < tasks:
                total = 0
                for _ in range(task):
                    total += task
                first[task] = total
                ti.atomic_add(visits[task], 1)
                finish(roster, 0)
                task = take(roster, 0, worker, workers, tasks)
            await_all(roster, 0, tasks)
            task = take(roster, 1, worker, workers, tasks)
            while task < tasks:
                second[task] = first[(task + 1) % tasks] + first[(task + tasks - 1) % tasks]
                task = take(roster, 1, worker, workers, tasks)


@pytest.mark.parametrize(("workers", "tasks"), [(1, 1), (1, 7), (2, 1), (2, 2), (2, 9), (7, 3), (16, 40)])
def test_a_phase_sees_all_of_the_one_before_whoever_did_it(workers, tasks):
    device.start()
    square = np.arange(tasks) ** 2
    for _ in range(50):
        first, second, visits = (np.zeros(tasks, np.int32) for _ in range(3))
        neighbours_sum(workers, roster(2, workers), first, second, visits)
        assert (visits == 1).all()
        assert np.array_equal(first, square)
        assert np.array_equal(second, np.roll(square, -1) + np.roll(square, 1))


@pytest.mark.parametrize(
    ("written", "cores"), [("max 100000\n", 8), ("200000 100000\n", 2), ("150000 100000\n", 2), ("50000 100000\n", 1), ("", 8), (None, 8)]
)
def test_a_containers_share_of_the_processor_counts(tmp_path, monkeypatch, written, cores):
    quota = tmp_path / "cpu.max"
    if written is not None:
        quota.write_text(written)
    monkeypatch.setattr(device, "QUOTA", quota)
    monkeypatch.delenv("SEEING_WIND_THREADS", raising=False)
    monkeypatch.setattr(device.os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    assert device.cores() == cores
