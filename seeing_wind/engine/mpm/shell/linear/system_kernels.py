"""The matrix of a Newton iteration and its products, compiled. See `system`."""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ...compiler import ti

integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
pairs = ti.types.ndarray(dtype=ti.i32, ndim=2)
doubles = ti.types.ndarray(dtype=ti.f64, ndim=1)
rows = ti.types.ndarray(dtype=ti.f64, ndim=2)
matrices = ti.types.ndarray(dtype=ti.f64, ndim=3)
results = ti.types.ndarray(ndim=3)

NOT_NEAR, HELD, ALONE = -1, -2, -3
"""In place of a block's source: it is not a near block; one of its vertices is pinned; it is the diagonal block of a pinned vertex."""


@ti.kernel
def near_blocks(
    twins: pairs, first: integers, corner: pairs, F: matrices, slope: matrices, tangent: rows, tension: rows, of_vertices: matrices,
    block_out: matrices,
):  # fmt: skip
    """Near blocks (n, 3, 3), one for each vertex and each pair of vertices with a common face, as sums over faces.

    The block of corners i, j of a face is F K F^T + (g_i S g_j) 1, with K = G_i^T T G_j, where G_i takes a displacement of corner i to a
    strain, g_i is the gradient of its hat function, T the tangent and S the stress.

    Args:
        twins: (m, 3) numbers of a block and of its transpose, and the vertex if the block is a diagonal one, else -1.
        first, corner: (m + 1,), (k, 3) the faces, each with two of its corners, that contribute to each block.
        F: (F, 3, 2), slope: (F, 3, 2); tangent: (F, 6), tension: (F, 3) times the area; of_vertices: (V, 3, 3) added on the diagonal.
    """
    for pair in range(twins.shape[0]):
        block, transposed, vertex = twins[pair, 0], twins[pair, 1], twins[pair, 2]
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                block_out[block, i, j] = 0.0
        if vertex >= 0:
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    block_out[block, i, j] = of_vertices[vertex, i, j]
        for k in range(first[pair], first[pair + 1]):
            f, p, q = corner[k, 0], corner[k, 1], corner[k, 2]
            a0, a1, b0, b1 = slope[f, p, 0], slope[f, p, 1], slope[f, q, 0], slope[f, q, 1]
            T00, T01, T02, T11, T12, T22 = tangent[f, 0], tangent[f, 1], tangent[f, 2], tangent[f, 3], tangent[f, 4], tangent[f, 5]
            K00 = a0 * (b0 * T00 + b1 * T02) + a1 * (b0 * T02 + b1 * T22)
            K01 = a0 * (b1 * T01 + b0 * T02) + a1 * (b1 * T12 + b0 * T22)
            K10 = a1 * (b0 * T01 + b1 * T12) + a0 * (b0 * T02 + b1 * T22)
            K11 = a1 * (b1 * T11 + b0 * T12) + a0 * (b1 * T12 + b0 * T22)
            taut = a0 * (b0 * tension[f, 0] + b1 * tension[f, 2]) + a1 * (b0 * tension[f, 2] + b1 * tension[f, 1])
            for j in ti.static(range(3)):
                c, d = K00 * F[f, j, 0] + K01 * F[f, j, 1], K10 * F[f, j, 0] + K11 * F[f, j, 1]
                for i in ti.static(range(3)):
                    block_out[block, i, j] = block_out[block, i, j] + F[f, i, 0] * c + F[f, i, 1] * d
                block_out[block, j, j] = block_out[block, j, j] + taut
        if transposed != block:
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    block_out[transposed, j, i] = block_out[block, i, j]


@ti.kernel
def factored_blocks(source: integers, hinge: doubles, constants: doubles, near: matrices, block_out: results):
    """Blocks of the matrix that is factored: near blocks plus the simpler bending, and for pinned vertices inertia alone.

    constants: the factor on bending, and inertia [N/m].
    """
    for k in range(source.shape[0]):
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                value = 0.0 * constants[0]
                if source[k] >= 0:
                    value = near[source[k], i, j]
                if ti.static(i == j):
                    if source[k] >= NOT_NEAR:
                        value += constants[0] * hinge[k]
                    if source[k] == ALONE:
                        value = constants[1]
                block_out[k, i, j] = ti.cast(value, float)


@ti.kernel
def product(
    first: integers, column: integers, near: matrices, first_bent: integers, bent: integers, bending: doubles, constants: doubles,
    free: integers, x: rows, product_out: rows,
):  # fmt: skip
    """The matrix times x (V, 3): near blocks plus `constants[0]` times the matrix of bending; zero at vertices that are not free."""
    for v in range(x.shape[0]):
        a, b, c = 0.0 * x[v, 0], 0.0 * x[v, 0], 0.0 * x[v, 0]
        if free[v] != 0:
            for k in range(first_bent[v], first_bent[v + 1]):
                a += bending[k] * x[bent[k], 0]
                b += bending[k] * x[bent[k], 1]
                c += bending[k] * x[bent[k], 2]
            a, b, c = constants[0] * a, constants[0] * b, constants[0] * c
            for k in range(first[v], first[v + 1]):
                j = column[k]
                x0, x1, x2 = x[j, 0], x[j, 1], x[j, 2]
                a += near[k, 0, 0] * x0 + near[k, 0, 1] * x1 + near[k, 0, 2] * x2
                b += near[k, 1, 0] * x0 + near[k, 1, 1] * x1 + near[k, 1, 2] * x2
                c += near[k, 2, 0] * x0 + near[k, 2, 1] * x1 + near[k, 2, 2] * x2
        product_out[v, 0], product_out[v, 1], product_out[v, 2] = a, b, c
