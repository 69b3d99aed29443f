"""Solves with the factors of `front_kernels`, compiled.

A vector is split by fronts: `own` has the numbers of the rows that a front eliminates, `below` those of the later rows that it touches. In
the forward pass a front adds its children's contributions to the right-hand side; in the backward pass it hands its children the parts of
the solution that they need.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ...compiler import ti
from .front_kernels import (
    BELOW,
    COUNT,
    FIRST,
    FIRST_CHILD,
    LAST_CHILD,
    OWN,
    PLACES,
    ROWS,
    TOUCHED,
    UPDATE,
    VECTOR,
    integers,
    numbers,
    table,
    vectors,
)

doubles = ti.types.ndarray(dtype=ti.f64, ndim=2)


@ti.func
def front_forward(
    front, fronts: ti.template(), children: ti.template(), places: ti.template(), vertex: ti.template(), right: ti.template(),
    rows_v: ti.template(), own: ti.template(), own_v: ti.template(), below: ti.template(), below_v: ti.template(),
):  # fmt: skip
    """A front's part of U^T y = right: y goes into `own`, and what its rows subtract from later rows into `below`."""
    mine, update, across = fronts[front, OWN], fronts[front, UPDATE], fronts[front, OWN] + fronts[front, UPDATE]
    to, under = fronts[front, VECTOR], fronts[front, BELOW]
    own_v[to + mine - 1] = ti.Vector.zero(float, 8)  # clears the padding after the last number
    first = fronts[front, FIRST]
    for k in range(fronts[front, COUNT] // 3):
        for i in ti.static(range(3)):
            own[8 * to + 3 * k + i] = ti.cast(right[vertex[first + k], i], float)
    for j in range(update):
        below_v[under + j] = ti.Vector.zero(float, 8)
    for k in range(fronts[front, FIRST_CHILD], fronts[front, LAST_CHILD]):
        child = children[k]
        place, theirs = fronts[child, PLACES], 8 * fronts[child, BELOW]
        for p in range(fronts[child, TOUCHED]):
            on = in_line(places[place + p])
            if on < 8 * mine:
                own[8 * to + on] = own[8 * to + on] + below[theirs + p]
            else:
                on += 8 * (under - mine)
                below[on] = below[on] + below[theirs + p]
    for i in range(mine):
        here = fronts[front, ROWS] + 8 * (i * across + i)
        v = own_v[to + i]
        y = v[0] * rows_v[here]
        for r in ti.static(range(1, 8)):
            y = y + v[r] * rows_v[here + r]
        own_v[to + i] = y
        for j in range(i + 1, mine):
            here += 8
            own_v[to + j] = less_rows(own_v[to + j], y, here, rows_v)
        for j in range(update):
            here += 8
            below_v[under + j] = less_rows(below_v[under + j], y, here, rows_v)


@ti.func
def in_line(place):
    """The number of a row, from its entry in `places`: where the column of the same number begins in a row of tiles."""
    unsigned = ti.cast(place, ti.u32)
    return ti.cast(unsigned // 64 * 8 + unsigned % 8, ti.i32)


@ti.func
def less_rows(t, y, tile, tiles: ti.template()):
    """t (8,) minus y times a tile. Two separate sums, because each addition has to wait for the one before it."""
    even, odd = t - y[0] * tiles[tile], y[1] * tiles[tile + 1]
    for r in ti.static(range(2, 8, 2)):
        even = even - y[r] * tiles[tile + r]
        odd = odd + y[r + 1] * tiles[tile + r + 1]
    return even - odd


@ti.func
def plus_rows(first, second, count, t0, t1, t2, t3, t4, t5, t6, t7, tiles: ti.template(), x: ti.template()):
    """The sums t0..t7, one vector for each row of a tile, plus the elementwise products of `count` tiles with as many vectors of x."""
    here = first
    for j in range(second, second + count):
        v = x[j]
        t0 = t0 + tiles[here] * v
        t1 = t1 + tiles[here + 1] * v
        t2 = t2 + tiles[here + 2] * v
        t3 = t3 + tiles[here + 3] * v
        t4 = t4 + tiles[here + 4] * v
        t5 = t5 + tiles[here + 5] * v
        t6 = t6 + tiles[here + 6] * v
        t7 = t7 + tiles[here + 7] * v
        here += 8
    return t0, t1, t2, t3, t4, t5, t6, t7


@ti.func
def front_backward(
    front, fronts: ti.template(), children: ti.template(), places: ti.template(), vertex: ti.template(), x_out: ti.template(),
    rows_v: ti.template(), own: ti.template(), own_v: ti.template(), below: ti.template(), below_v: ti.template(),
):  # fmt: skip
    """A front's part of U x = y: takes y from `own`, puts x into `own` and x_out, and what the children need into their `below`."""
    mine, update, across = fronts[front, OWN], fronts[front, UPDATE], fronts[front, OWN] + fronts[front, UPDATE]
    to, under = fronts[front, VECTOR], fronts[front, BELOW]
    for back in range(mine):
        i = mine - 1 - back
        here = fronts[front, ROWS] + 8 * (i * across + i)
        z = ti.Vector.zero(float, 8)
        t0, t1, t2, t3, t4, t5, t6, t7 = z, z, z, z, z, z, z, z
        t0, t1, t2, t3, t4, t5, t6, t7 = plus_rows(here + 8, to + i + 1, mine - i - 1, t0, t1, t2, t3, t4, t5, t6, t7, rows_v, own_v)
        later = here + 8 * (mine - i)
        t0, t1, t2, t3, t4, t5, t6, t7 = plus_rows(later, under, update, t0, t1, t2, t3, t4, t5, t6, t7, rows_v, below_v)
        y = own_v[to + i] - ti.Vector([t0.sum(), t1.sum(), t2.sum(), t3.sum(), t4.sum(), t5.sum(), t6.sum(), t7.sum()])
        own_v[to + i] = ti.Vector([(rows_v[here + r] * y).sum() for r in ti.static(range(8))])
    first = fronts[front, FIRST]
    for k in range(fronts[front, COUNT] // 3):
        for i in ti.static(range(3)):
            x_out[vertex[first + k], i] = own[8 * to + 3 * k + i]
    for k in range(fronts[front, FIRST_CHILD], fronts[front, LAST_CHILD]):
        child = children[k]
        place, theirs = fronts[child, PLACES], 8 * fronts[child, BELOW]
        for p in range(fronts[child, TOUCHED]):
            on = in_line(places[place + p])
            if on < 8 * mine:
                below[theirs + p] = own[8 * to + on]
            else:
                below[theirs + p] = below[8 * (under - mine) + on]


@ti.kernel
def forward(
    begin: ti.i32, end: ti.i32, runs: table, fronts: table, children: integers, places: integers, vertex: integers, right: doubles,
    rows_v: vectors, own: numbers, own_v: vectors, below: numbers, below_v: vectors,
):  # fmt: skip
    """U^T y = right for the fronts of runs begin..end, the runs at the same time."""
    ti.loop_config(block_dim=1)
    for run in range(begin, end):
        for front in range(runs[run, 0], runs[run, 1]):
            front_forward(front, fronts, children, places, vertex, right, rows_v, own, own_v, below, below_v)


@ti.kernel
def backward(
    begin: ti.i32, end: ti.i32, runs: table, fronts: table, children: integers, places: integers, vertex: integers, x_out: doubles,
    rows_v: vectors, own: numbers, own_v: vectors, below: numbers, below_v: vectors,
):  # fmt: skip
    """U x = y for the fronts of runs begin..end, the runs at the same time."""
    ti.loop_config(block_dim=1)
    for run in range(begin, end):
        for back in range(runs[run, 1] - runs[run, 0]):
            front_backward(runs[run, 1] - 1 - back, fronts, children, places, vertex, x_out, rows_v, own, own_v, below, below_v)


@ti.kernel
def there_and_back(
    begin: ti.i32, end: ti.i32, runs: table, fronts: table, children: integers, places: integers, vertex: integers, right: doubles,
    x_out: doubles, rows_v: vectors, own: numbers, own_v: vectors, below: numbers, below_v: vectors,
):  # fmt: skip
    """`forward`, then `backward`, for the fronts of runs begin..end, one after another, on this thread."""
    run = begin  # the compiler would share an outermost for loop out to threads
    while run < end:
        for front in range(runs[run, 0], runs[run, 1]):
            front_forward(front, fronts, children, places, vertex, right, rows_v, own, own_v, below, below_v)
        run += 1
    while run > begin:
        run -= 1
        for back in range(runs[run, 1] - runs[run, 0]):
            front_backward(runs[run, 1] - 1 - back, fronts, children, places, vertex, x_out, rows_v, own, own_v, below, below_v)
