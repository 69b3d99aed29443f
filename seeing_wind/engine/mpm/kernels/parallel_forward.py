"""Substeps of one large body, one after the other in one launch; the cores go through them as a `crew`."""
# Taichi reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

import taichi as ti

from .crew import await_all, counters, finish, taken
from .packed import constants, forces, integers, lattice_of, nodes, numbers, states, window_of
from .parallel import (
    STOPPED,
    box_rows,
    flags,
    grid_to_particle,
    grid_to_task,
    lattice_rows,
    look,
    node_to_velocity,
    nodes_of_task,
    particle_to_grid,
    rows,
    task_to_grid,
)
from .substep import RUNNING, STRIDE
from .transfer import base_of

PHASES = 4
"""Of a substep: p2g, the nodes' velocities, g2p, a look at where the particles are."""


@ti.kernel
def substeps(
    gpu: ti.template(), plastic: ti.template(),
    count: ti.i32,  # substeps, in one array from the second on; 1 on a GPU; 0: p2g and the nodes' velocities of one only
    workers: ti.i32, roster: counters,  # on a CPU, see `crew`
    # body: `first` particle of every task
    first: integers, particle: constants, state: states, state_out: states, force: forces, pin_velocity: rows,
    # at the nodes, see `conditions.boundary_velocity` and `parallel.pushed`
    clamp: flags, clamp_velocity: lattice_rows, planes: rows, solid: lattice_rows, push: lattice_rows,
    # `lattice_of`; integers, see `Body`; boxes (tasks, BOX): first and last of the particles' first nodes, in and out, and their origin;
    # status (tasks, 2) out: code, particle
    lattice: numbers, window: integers, boxes: box_rows, status: box_rows,
    # grids: the tasks' own, one after the other, then momentum and velocity of all
    grid: nodes, momentum: nodes, velocity: nodes,
):  # fmt: skip
    """p2g, the nodes' velocities, g2p, until all substeps are done or one has stopped."""
    if ti.static(gpu):
        for node in range(window[3] * window[4] * window[5]):
            grid[node] = ti.Vector.zero(float, 4)
        for p in range(state.shape[0] // 6):
            offset, dx, dt = lattice_of(lattice)
            lo, dims = window_of(window)
            particle_to_grid(True, plastic, p, 0, particle, state, force, offset, dx, dt, lo, dims, grid)
        for node in range(window[3] * window[4] * window[5]):
            offset, dx, dt = lattice_of(lattice)
            node_to_velocity(node, 1, window, boxes, grid, momentum, velocity, offset, dx, dt, clamp, clamp_velocity, planes, solid, push)
        for a in range(6 * count):
            boxes[0, a] = ti.select(a < 3, 2**30, -(2**30))
        for p in range(state.shape[0] // 6 * count):
            offset, dx, dt = lattice_of(lattice)
            lo, dims = window_of(window)
            code, x = grid_to_particle(plastic, p, particle, state, state_out, pin_velocity, offset, dx, dt, lo, dims, velocity)
            if code != RUNNING:
                status[0, 0], status[0, 1] = code, p
            base = base_of(ti.Vector([x[0], x[1], x[2]]), offset, 1.0 / dx)
            for a in ti.static(range(3)):
                ti.atomic_min(boxes[0, a], base[a])
                ti.atomic_max(boxes[0, 3 + a], base[a])
    else:
        # Taichi runs loops of less than about a thousand turns on one thread: a worker is STRIDE turns, all but one of them empty.
        ti.loop_config(block_dim=STRIDE)
        for turn in range(workers * STRIDE):
            if turn % STRIDE == 0:
                worker, tasks = turn // STRIDE, first.shape[0] - 1
                phase, last = 0, PHASES * ti.max(count, 1)
                while phase < last:
                    task = taken(roster, phase, worker, workers, tasks)
                    while task < tasks:
                        task_to_grid(task, plastic, first, particle, state, force, lattice, window, boxes, grid)
                        finish(roster, phase)
                        task = taken(roster, phase, worker, workers, tasks)
                    await_all(roster, phase, tasks)
                    task = taken(roster, phase + 1, worker, workers, tasks)
                    while task < tasks:
                        nodes_of_task(
                            task, tasks, window, boxes, grid, momentum, velocity, lattice, clamp, clamp_velocity, planes, solid, push
                        )
                        finish(roster, phase + 1)
                        task = taken(roster, phase + 1, worker, workers, tasks)
                    if count > 0:
                        await_all(roster, phase + 1, tasks)
                        task = taken(roster, phase + 2, worker, workers, tasks)
                        while task < tasks:
                            grid_to_task(
                                task, plastic, first, particle, state, state_out, pin_velocity, lattice, window, boxes, status, velocity
                            )
                            finish(roster, phase + 2)
                            task = taken(roster, phase + 2, worker, workers, tasks)
                        await_all(roster, phase + 2, tasks)
                        if taken(roster, phase + 3, worker, workers, 1) == 0:
                            look(tasks, window, boxes, status)
                            finish(roster, phase + 3)
                        await_all(roster, phase + 3, 1)
                    # Whoever is late and sees the stop of a later substep finds nothing to do in between either.
                    phase = ti.select(window[STOPPED] != 0, last, phase + PHASES)
