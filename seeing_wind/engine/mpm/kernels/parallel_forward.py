"""Substeps of one large body, one after another in one launch, shared by the cores as a `crew`."""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from .crew import await_all, counters, finish, take
from .packed import constants, flags, forces, integers, lattice_rows, nodes, numbers, rows, states, table
from .parallel import STOPPED, grid_to_task, move_bounds, nodes_of_task, task_to_grid
from .substep import STRIDE

PHASES = 4
"""Phases of a substep: p2g, the nodes' velocities, g2p, new bounds of the nodes in use."""


@ti.kernel
def substeps(
    plastic: ti.template(),
    count: ti.i32,  # of substeps; more than one need state_out to be state. 0: only p2g and the nodes' velocities of one substep
    workers: ti.i32, roster: counters,  # see `crew`
    # body: `first` particle of every task
    first: integers, particle: constants, state: states, state_out: states, force: forces, pin_velocity: rows,
    # at the nodes, see `conditions.boundary_velocity`
    clamp: flags, clamp_velocity: lattice_rows, planes: rows, solid: lattice_rows,
    # `lattice_of`; bounds, see `Body`; boxes (tasks, BOX), in and out: first and last of the particles' first nodes, and ORIGIN;
    # status (tasks, 2) out: code, particle
    lattice: numbers, bounds: integers, boxes: table, status: table,
    # grids: the tasks' own, one after another, then momentum and velocity of all nodes
    grid: nodes, momentum: nodes, velocity: nodes,
):  # fmt: skip
    """p2g, the nodes' velocities and g2p, until all substeps are done or the run must stop."""
    ti.loop_config(block_dim=STRIDE)
    for turn in range(workers * STRIDE):
        if turn % STRIDE == 0:
            worker, tasks = turn // STRIDE, first.shape[0] - 1
            phase, last = 0, PHASES * ti.max(count, 1)
            while phase < last:
                task = take(roster, phase, worker, workers, tasks)
                while task < tasks:
                    task_to_grid(task, plastic, first, particle, state, force, lattice, bounds, boxes, grid)
                    finish(roster, phase)
                    task = take(roster, phase, worker, workers, tasks)
                await_all(roster, phase, tasks)
                task = take(roster, phase + 1, worker, workers, tasks)
                while task < tasks:
                    nodes_of_task(
                        task, tasks, bounds, boxes, grid, momentum, velocity, lattice, clamp, clamp_velocity, planes, solid
                    )
                    finish(roster, phase + 1)
                    task = take(roster, phase + 1, worker, workers, tasks)
                if count > 0:
                    await_all(roster, phase + 1, tasks)
                    task = take(roster, phase + 2, worker, workers, tasks)
                    while task < tasks:
                        grid_to_task(
                            task, plastic, first, particle, state, state_out, pin_velocity, lattice, bounds, boxes, status, velocity
                        )
                        finish(roster, phase + 2)
                        task = take(roster, phase + 2, worker, workers, tasks)
                    await_all(roster, phase + 2, tasks)
                    if take(roster, phase + 3, worker, workers, 1) == 0:
                        move_bounds(tasks, bounds, boxes, status)
                        finish(roster, phase + 3)
                    await_all(roster, phase + 3, 1)
                # A worker that is late and already sees the stop of a later substep has no tasks left in between.
                phase = ti.select(bounds[STOPPED] != 0, last, phase + PHASES)
