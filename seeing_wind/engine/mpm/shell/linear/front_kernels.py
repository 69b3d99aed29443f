"""Factors of the dense parts of a sparse matrix, compiled; `solve_kernels` solves with them.

A front is a dense symmetric matrix: first the rows that it eliminates, then those of the later vertices that these touch. Only the upper
half is used. It is stored in tiles of 8 x 8 numbers, each of 8 vectors of the processor, so that two tiles are multiplied within
registers. Padding rows, with ones on the diagonal, fill up the last tiles.

    rows       an eliminated front's rows U of U^T U, tile after tile, upper row of tiles first; on the diagonal the inverses of U's tiles
    remainder  the update matrix for the front's parent, in tiles as well

The fronts of a run are done one after another, and the runs of a level at the same time.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ...compiler import ti

OWN, UPDATE = 0, 1
"""Columns of the table, which has a row for each front: the width in tiles of the rows it eliminates, and of the later rows these touch."""
COUNT, TOUCHED, FIRST = 2, 3, 4
"""How many rows the front eliminates, how many later ones it touches, and the first vertex, in the order, that it eliminates."""
ROWS, REMAINDER = 5, 6
"""The first vectors of its rows and of its remainder."""
FIRST_BLOCK, LAST_BLOCK, FIRST_CHILD, LAST_CHILD = 7, 8, 9, 10
"""The ranges of its blocks of the matrix and of its entries in the list of children."""
PLACES = 11
"""Where its list of places begins: for each column of its remainder, where the parent's column begins in a row of tiles."""
VECTOR, BELOW = 12, 13
"""In a solve, the first vectors of its own numbers, and of those of the later rows that it touches."""
LENGTH = 14
"""Number of columns of the table."""
TILE = 8
"""Rows and columns of a tile."""

integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
table = ti.types.ndarray(dtype=ti.i32, ndim=2)
numbers = ti.types.ndarray(ndim=1)
vectors = ti.types.ndarray(element_shape=(8,), ndim=1)
blocks = ti.types.ndarray(ndim=3)


@ti.func
def at(row, column, across):
    """Index of the entry (row, column) in a matrix stored in tiles, `across` tiles to a row."""
    return ((row // 8) * across + column // 8) * 64 + (row % 8) * 8 + column % 8


@ti.func
def less_products(first, second, step, count, t0, t1, t2, t3, t4, t5, t6, t7, number: ti.template(), vector: ti.template()):
    """The tile t0..t7 minus the sum of the products A^T B over `count` pairs of tiles, which begin at the vectors `first` and `second` and
    follow each other at intervals of `step` vectors."""
    a, b = first, second
    for _ in range(count):
        for r in range(8):  # unrolled it is no faster, and takes more than twice as long to compile
            v, s = vector[b + r], 8 * (a + r)
            t0 = t0 - number[s] * v
            t1 = t1 - number[s + 1] * v
            t2 = t2 - number[s + 2] * v
            t3 = t3 - number[s + 3] * v
            t4 = t4 - number[s + 4] * v
            t5 = t5 - number[s + 5] * v
            t6 = t6 - number[s + 6] * v
            t7 = t7 - number[s + 7] * v
        a += step
        b += step
    return t0, t1, t2, t3, t4, t5, t6, t7


@ti.func
def load_tile(first, vector: ti.template()):
    """The tile that begins at the vector `first`."""
    return (
        vector[first], vector[first + 1], vector[first + 2], vector[first + 3], vector[first + 4], vector[first + 5], vector[first + 6],
        vector[first + 7],
    )  # fmt: skip


@ti.func
def store_tile(first, t0, t1, t2, t3, t4, t5, t6, t7, vector: ti.template()):
    """Store a tile from the vector `first` on."""
    vector[first] = t0
    vector[first + 1] = t1
    vector[first + 2] = t2
    vector[first + 3] = t3
    vector[first + 4] = t4
    vector[first + 5] = t5
    vector[first + 6] = t6
    vector[first + 7] = t7


@ti.func
def clear(first, count, vector: ti.template()):
    """Set `count` vectors to zero, from `first` on."""
    for i in range(first, first + count):
        vector[i] = ti.Vector.zero(float, 8)


@ti.func
def invert_tile(first, number: ti.template()):
    """Replace a tile U^T U, of which only the upper half is used, by the inverse of U; returns whether the tile is positive definite."""
    fine = 1
    base = 8 * first
    for k in range(8):
        d = number[base + 9 * k]
        if not d > 0.0:
            fine = 0
        inverse = 1.0 / ti.sqrt(d)
        number[base + 9 * k] = inverse  # of U's diagonal entry
        for j in range(k + 1, 8):
            number[base + 8 * k + j] = number[base + 8 * k + j] * inverse
        for i in range(k + 1, 8):
            s = number[base + 8 * k + i]
            for j in range(i, 8):
                number[base + 8 * i + j] = number[base + 8 * i + j] - s * number[base + 8 * k + j]
    for i in range(8):  # the inverse V of U, column by column: V_ij = -V_jj sum over k of V_ik U_kj
        for k in range(i):
            number[base + 8 * i + k] = 0.0
    for j in range(1, 8):
        v = number[base + 9 * j]
        # column j of U is replaced by column j of V, from the columns of V before it
        for i in range(j):
            total = ti.cast(0.0, float)
            for k in range(i, j):
                total += number[base + 8 * i + k] * number[base + 8 * k + j]
            number[base + 8 * i + j] = -v * total
    return fine


@ti.func
def add_row(to, source, place, p, size, places: ti.template(), row: ti.template(), remainder: ti.template(), remainder_v: ti.template()):
    """Add row p of a child's remainder, from the diagonal on, to the row that begins at `to`."""
    whole = (p + 7) // 8
    for q in range(p, ti.min(8 * whole, size)):
        on = to + places[place + q]
        row[on] = row[on] + remainder[source + (q // 8) * 64 + q % 8]
    for tile in range(whole, (size + 7) // 8):
        v, k = remainder_v[source // 8 + tile * 8], place + 8 * tile
        for q in ti.static(range(8)):
            on = to + places[k + q]
            row[on] = row[on] + v[q]


@ti.func
def assemble(
    front, fronts: ti.template(), slots: ti.template(), block: ti.template(), children: ti.template(), places: ti.template(),
    row: ti.template(), remainder: ti.template(), rows_v: ti.template(), remainder_v: ti.template(),
):  # fmt: skip
    """Fill a front with its blocks of the matrix plus its children's remainders."""
    own, update = fronts[front, OWN], fronts[front, UPDATE]
    across, rows, rest = own + update, fronts[front, ROWS], fronts[front, REMAINDER]
    for i in range(own):
        clear(rows + 8 * i * (across + 1), 8 * (across - i), rows_v)
    for i in range(update):
        clear(rest + 8 * i * (update + 1), 8 * (update - i), remainder_v)
    for i in range(fronts[front, COUNT], 8 * own):
        row[8 * rows + at(i, i, across)] = 1.0
    for slot in range(fronts[front, FIRST_BLOCK], fronts[front, LAST_BLOCK]):
        first, second = slots[slot, 0], slots[slot, 1]
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                row[8 * rows + at(first + j, second + i, across)] = block[slot, i, j]
    for k in range(fronts[front, FIRST_CHILD], fronts[front, LAST_CHILD]):
        child = children[k]
        size, place, theirs, wide = fronts[child, TOUCHED], fronts[child, PLACES], 8 * fronts[child, REMAINDER], fronts[child, UPDATE]
        for p in range(size):
            to = ti.cast(places[place + p], ti.u32)  # unsigned: a division is then a shift
            source = theirs + (p // 8) * wide * 64 + (p % 8) * 8
            i, j = ti.cast(to // 64, ti.i32), ti.cast(to % 8, ti.i32)
            if i < own:
                add_row(8 * rows + i * across * 64 + j * 8, source, place, p, size, places, row, remainder, remainder_v)
            else:
                line = 8 * rest + (i - own) * update * 64 + j * 8
                add_row(line - 64 * own, source, place, p, size, places, remainder, remainder, remainder_v)


@ti.func
def eliminate(front, fronts: ti.template(), row: ti.template(), rows_v: ti.template(), remainder_v: ti.template()):
    """Factor a front's rows in place and subtract their products from the remainder; returns whether the front is positive definite."""
    own, update = fronts[front, OWN], fronts[front, UPDATE]
    across, rows, rest = own + update, fronts[front, ROWS], fronts[front, REMAINDER]
    step, fine = 8 * across, 1
    for i in range(own):
        for j in range(i, across):
            here = rows + 8 * (i * across + j)
            t0, t1, t2, t3, t4, t5, t6, t7 = load_tile(here, rows_v)
            t0, t1, t2, t3, t4, t5, t6, t7 = less_products(rows + 8 * i, rows + 8 * j, step, i, t0, t1, t2, t3, t4, t5, t6, t7, row, rows_v)
            store_tile(here, t0, t1, t2, t3, t4, t5, t6, t7, rows_v)
        diagonal = rows + 8 * (i * across + i)
        if invert_tile(diagonal, row) == 0:
            fine = 0
        for j in range(i + 1, across):
            here = rows + 8 * (i * across + j)
            z = ti.Vector.zero(float, 8)
            t0, t1, t2, t3, t4, t5, t6, t7 = less_products(diagonal, here, step, 1, z, z, z, z, z, z, z, z, row, rows_v)
            store_tile(here, z - t0, z - t1, z - t2, z - t3, z - t4, z - t5, z - t6, z - t7, rows_v)
    for i in range(update):
        for j in range(i, update):
            here = rest + 8 * (i * update + j)
            t0, t1, t2, t3, t4, t5, t6, t7 = load_tile(here, remainder_v)
            t0, t1, t2, t3, t4, t5, t6, t7 = less_products(
                rows + 8 * (own + i), rows + 8 * (own + j), step, own, t0, t1, t2, t3, t4, t5, t6, t7, row, rows_v
            )
            store_tile(here, t0, t1, t2, t3, t4, t5, t6, t7, remainder_v)
    return fine


@ti.kernel
def factor(
    begin: ti.i32, end: ti.i32, runs: table, fronts: table, slots: table, block: blocks, children: integers, places: integers,
    row: numbers, rows_v: vectors, remainder: numbers, remainder_v: vectors, failed: integers,
):  # fmt: skip
    """Factor the fronts of runs begin..end; `failed` gets 1 for each front that is not positive definite, else 0."""
    ti.loop_config(block_dim=1)
    for run in range(begin, end):
        for front in range(runs[run, 0], runs[run, 1]):
            assemble(front, fronts, slots, block, children, places, row, remainder, rows_v, remainder_v)
            failed[front] = 1 - eliminate(front, fronts, row, rows_v, remainder_v)
