"""The forces of faces, compiled: stress and its tangent (`membrane`), moments (`bending`), and their sum at the vertices.

All arrays are float64. A symmetric 3 x 3 matrix is stored as six numbers: 00, 01, 02, 11, 12, 22.
"""
# The compiler reads the annotations of kernels at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti
from .membrane import FIRM, SLACK

integers = ti.types.ndarray(dtype=ti.i32, ndim=1)
corners = ti.types.ndarray(dtype=ti.i32, ndim=2)
numbers = ti.types.ndarray(ndim=1)
rows = ti.types.ndarray(ndim=2)
matrices = ti.types.ndarray(ndim=3)

STIFFNESS, RATIO, LAG, LAW = range(4)
"""Places in `sheet`: tensile stiffness Y [N/m], Poisson's ratio, retardation time over the substep; from LAW on, the 3 x 3 law of bending
[N m], row by row."""


@ti.func
def principal(E0, E1, E2, Y, nu, N):
    """For the strain E0 = E11, E1 = E22, E2 = 2 E12 and the buckling load N: the principal strains plus N (1 - nu) / Y, the larger first;
    the principal stresses plus N; how far each principal strain lies below -SLACK (negative, else 0); cos and sin of twice the angle from
    the face's first axis to the first principal direction."""
    shift = N * (1.0 - nu) / Y
    mean, half, shear = 0.5 * (E0 + E1) + shift, 0.5 * (E0 - E1), 0.5 * E2
    radius = ti.sqrt(half * half + shear * shear)
    cos, sin = 1.0, 0.0
    if radius > 0.0:
        cos, sin = half / radius, shear / radius
    first, second = mean + radius, mean - radius
    plane = Y / (1.0 - nu * nu)
    sigma, across = plane * (first + nu * second), plane * (second + nu * first)
    if not across > 0.0:
        sigma, across = Y * ti.max(first, 0.0), 0.0
    return first, second, sigma, across, ti.min(first - shift + SLACK, 0.0), ti.min(second - shift + SLACK, 0.0), cos, sin


@ti.func
def strain(face, F: ti.template()):
    """Green's strain E11, E22, 2 E12."""
    a, b, c = -1.0, -1.0, 0.0
    for i in ti.static(range(3)):
        a += F[face, i, 0] * F[face, i, 0]
        b += F[face, i, 1] * F[face, i, 1]
        c += F[face, i, 0] * F[face, i, 1]
    return 0.5 * a, 0.5 * b, c


@ti.func
def difference(x: ti.template(), p, q):
    """x_q - x_p."""
    return x[q, 0] - x[p, 0], x[q, 1] - x[p, 1], x[q, 2] - x[p, 2]


@ti.func
def cross(a0, a1, a2, b0, b1, b2):
    """a x b."""
    return a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0


@ti.kernel
def forces_of_faces(
    x: rows, faces: corners, slope: matrices, area: numbers, buckling: numbers, sheet: numbers, stress_before: rows, first: integers,
    vertex: integers, weight: rows, rest: rows, curved: ti.i32, curvature_before: rows, F_out: matrices, stress_out: rows,
    curvature_out: rows, gradient_out: matrices, moment_out: matrices,
):  # fmt: skip
    """Of every face with vertices at x (V, 3): deformation F (F, 3, 2), stress (F, 3), curvature (F, 3), the energy's derivative with
    respect to the corners (F, 3, 3), and the moments times the area, a vector each (F, 3, 3).

    Args:
        stress_before, curvature_before: (F, 3) elastic values at the substep's start, relative to which damping is computed.
        first, vertex, weight: (F + 1,), (n,), (n, 3); the curvature of face f is the sum of weight[j] x[vertex[j]] over j from first[f]
            to first[f + 1].
        rest: (F, 3) curvature at rest; curved: 0 if it is zero everywhere.
    """
    for face in range(faces.shape[0]):
        Y, nu, lag, N = sheet[STIFFNESS], sheet[RATIO], sheet[LAG], buckling[face]
        for i in ti.static(range(3)):
            for a in ti.static(range(2)):
                total = 0.0
                for corner in ti.static(range(3)):
                    total += x[faces[face, corner], i] * slope[face, corner, a]
                F_out[face, i, a] = total
        E0, E1, E2 = strain(face, F_out)
        _first, _second, sigma, across, excess, excess_across, cos, sin = principal(E0, E1, E2, Y, nu, N)
        sigma += FIRM * Y * excess
        across += FIRM * Y * excess_across
        mean, half = 0.5 * (sigma + across) - N, 0.5 * (sigma - across)
        S0 = (1.0 + lag) * (mean + half * cos) - lag * stress_before[face, 0]
        S1 = (1.0 + lag) * (mean - half * cos) - lag * stress_before[face, 1]
        S2 = (1.0 + lag) * half * sin - lag * stress_before[face, 2]
        stress_out[face, 0], stress_out[face, 1], stress_out[face, 2] = S0, S1, S2
        for corner in ti.static(range(3)):
            g0, g1 = area[face] * slope[face, corner, 0], area[face] * slope[face, corner, 1]
            along, aside = g0 * S0 + g1 * S2, g0 * S2 + g1 * S1
            for i in ti.static(range(3)):
                gradient_out[face, corner, i] = along * F_out[face, i, 0] + aside * F_out[face, i, 1]

        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        u0, u1, u2 = difference(x, a, b)
        v0, v1, v2 = difference(x, a, c)
        n0, n1, n2 = cross(u0, u1, u2, v0, v1, v2)
        twice = ti.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        n0, n1, n2 = n0 / twice, n1 / twice, n2 / twice
        n = [n0, n1, n2]
        for k in ti.static(range(3)):
            for i in ti.static(range(3)):
                moment_out[face, k, i] = 0.0
        for j in range(first[face], first[face + 1]):
            for k in ti.static(range(3)):
                for i in ti.static(range(3)):
                    moment_out[face, k, i] = moment_out[face, k, i] + weight[j, k] * x[vertex[j], i]
        p0, p1, p2 = 0.0, 0.0, 0.0
        bent = ti.Matrix.zero(float, 3, 3)
        for k in ti.static(range(3)):
            along = 0.0
            for i in ti.static(range(3)):
                along += moment_out[face, k, i] * n[i]
            curvature_out[face, k] = along
            damped = lag * (along - curvature_before[face, k]) - rest[face, k]
            for i in ti.static(range(3)):
                bent[k, i] = moment_out[face, k, i] + damped * n[i]
            at_rest = 0.0
            for l in ti.static(range(3)):
                at_rest += area[face] * sheet[LAW + 3 * k + l] * rest[face, l]
            p0 += at_rest * moment_out[face, k, 0]
            p1 += at_rest * moment_out[face, k, 1]
            p2 += at_rest * moment_out[face, k, 2]
        for k in ti.static(range(3)):
            for i in ti.static(range(3)):
                total = 0.0
                for l in ti.static(range(3)):
                    total += sheet[LAW + 3 * k + l] * bent[l, i]
                moment_out[face, k, i] = area[face] * total
        if curved != 0:
            for corner in ti.static(range(3)):
                e0, e1, e2 = difference(x, faces[face, (corner + 1) % 3], faces[face, (corner + 2) % 3])
                h0, h1, h2 = cross(n[0], n[1], n[2], e0, e1, e2)
                turn = (h0 * p0 + h1 * p1 + h2 * p2) / twice
                for i in ti.static(range(3)):
                    gradient_out[face, corner, i] = gradient_out[face, corner, i] + turn * n[i]


@ti.kernel
def forces_of_vertices(
    x: rows, inertia: numbers, goal: rows, push: rows, gradient: matrices, moment: matrices, first: integers, corner: integers,
    first_bent: integers, face: integers, weight: rows, force_out: rows,
):  # fmt: skip
    """Minus the forces (V, 3) [N] of inertia (V,) [N/m] about `goal`, of `push` and of the faces.

    Args:
        first, corner: (V + 1,), (3 F,) the corners at each vertex, as 3 face + corner.
        first_bent, face, weight: (V + 1,), (n,), (n, 3) the faces whose curvature depends on each vertex, and with what weight.
    """
    for v in range(x.shape[0]):
        for i in ti.static(range(3)):
            force_out[v, i] = inertia[v] * (x[v, i] - goal[v, i]) - push[v, i]
        for j in range(first[v], first[v + 1]):
            f = corner[j] // 3
            for i in ti.static(range(3)):
                force_out[v, i] = force_out[v, i] + gradient[f, corner[j] % 3, i]
        for j in range(first_bent[v], first_bent[v + 1]):
            for i in ti.static(range(3)):
                add = weight[j, 0] * moment[face[j], 0, i] + weight[j, 1] * moment[face[j], 1, i] + weight[j, 2] * moment[face[j], 2, i]
                force_out[v, i] = force_out[v, i] + add


@ti.kernel
def tangents(
    area: numbers, buckling: numbers, sheet: numbers, convex: ti.i32, F: matrices, stress: rows, tangent_out: rows, tension_out: rows
):  # fmt: skip
    """dS/dE (F, 6) and the stress (F, 3), both times the area [N m]; if `convex`, the stress without its compressive part."""
    for face in range(area.shape[0]):
        Y, nu, lag = sheet[STIFFNESS], sheet[RATIO], sheet[LAG]
        E0, E1, E2 = strain(face, F)
        first, second, sigma, across, excess, excess_across, cos, sin = principal(E0, E1, E2, Y, nu, buckling[face])
        firm, firm_across = 0.0, 0.0
        if excess < 0.0:
            firm = FIRM * Y
        if excess_across < 0.0:
            firm_across = FIRM * Y
        a, b, o, turning = 0.0, 0.0, 0.0, Y / (2.0 * (1.0 + nu))
        gap = ti.max(first - second, 1e-300)
        if across > 0.0:
            a = Y / (1.0 - nu * nu)
            b, o = a, nu * a
        else:
            turning = 0.5 * (sigma - across) / gap
            if sigma > 0.0:
                a = Y
        if gap > 1e-9:
            turning += 0.5 * FIRM * Y * (excess - excess_across) / gap
        else:
            turning += 0.5 * firm
        a, b = a + firm, b + firm_across
        P, Q, W = 0.5 * (1.0 + cos), 0.5 * (1.0 - cos), 0.5 * sin
        R = [[P, Q, W], [Q, P, -W], [-2.0 * W, 2.0 * W, cos]]
        size = (1.0 + lag) * area[face]
        for k, i, j in ti.static(((0, 0, 0), (1, 0, 1), (2, 0, 2), (3, 1, 1), (4, 1, 2), (5, 2, 2))):
            mixed = o * (R[0][i] * R[1][j] + R[1][i] * R[0][j])
            tangent_out[face, k] = size * (a * R[0][i] * R[0][j] + b * R[1][i] * R[1][j] + mixed + turning * R[2][i] * R[2][j])
        S0, S1, S2 = stress[face, 0], stress[face, 1], stress[face, 2]
        if convex != 0:
            mean, half = 0.5 * (S0 + S1), 0.5 * (S0 - S1)
            radius = ti.sqrt(half * half + S2 * S2)
            if mean < radius:
                part = ti.max(mean + radius, 0.0) / ti.max(2.0 * radius, 1e-300)
                S0, S1, S2 = part * (radius + half), part * (radius - half), part * S2
        tension_out[face, 0], tension_out[face, 1], tension_out[face, 2] = area[face] * S0, area[face] * S1, area[face] * S2
