"""Boundary conditions of a grid node's velocity, at planes, in solid colliders and at pins, and their derivative.

They are applied once per substep, between momentum / mass and g2p. The contact law is that of Stomakhin et al. 2013, "A material point
method for snow simulation", section 8: relative to the wall, the normal component into it is removed, and Coulomb's friction reduces the
tangential component by up to mu times as much. Every branch is differentiated exactly; at a kink (just touching, just slipping) the
derivative is that of one side.
"""
# The compiler reads the annotations of functions at run time: they are values, which mypy cannot check and `annotations` may not postpone.
# mypy: ignore-errors

from ..compiler import ti

NONE, STICKY, SLIP, SEPARATE = 0, 1, 2, 3
"""Kinds of wall: none; a node moves with the wall (STICKY), may slide but neither enter nor leave (SLIP), or may also leave (SEPARATE)."""


@ti.func
def contact_velocity(v, n, kind, friction, wall):
    """Velocity of a node inside a wall with the outward unit normal n that moves with velocity `wall`; v: the node's velocity before."""
    u = v - wall
    along = u.dot(n)
    if kind == STICKY:
        u = ti.Vector.zero(float, 3)
    elif kind == SLIP or (kind == SEPARATE and along < 0.0):
        u = u - along * n
        speed = u.norm()
        loss = friction * ti.abs(along)
        if loss > speed:
            u = ti.Vector.zero(float, 3)
        elif loss > 0.0:
            u = (1.0 - loss / speed) * u
    return wall + u


@ti.func
def contact_jacobian(v, n, kind, friction, wall):
    """d contact_velocity / d v, (3, 3)."""
    J = ti.Matrix.identity(float, 3)
    u = v - wall
    along = u.dot(n)
    if kind == STICKY:
        J = ti.Matrix.zero(float, 3, 3)
    elif kind == SLIP or (kind == SEPARATE and along < 0.0):
        J = J - n.outer_product(n)
        u = u - along * n
        speed = u.norm()
        loss = friction * ti.abs(along)
        if loss > speed:
            J = ti.Matrix.zero(float, 3, 3)
        elif loss > 0.0:
            t, share, side = u / speed, loss / speed, ti.select(along < 0.0, -1.0, 1.0)
            J = (1.0 - share) * J + t.outer_product(share * t - (friction * side) * n)
    return J


@ti.func
def in_box(c, box: ti.template()):
    """Whether the index c (3,) lies in the first three axes of the array `box`."""
    return 0 <= c[0] < box.shape[0] and 0 <= c[1] < box.shape[1] and 0 <= c[2] < box.shape[2]


@ti.func
def place_of(node, offset, dx):
    """Position (3,) of the lattice's node (3,) int."""
    return ti.Vector([offset[a] + dx * node[a] for a in ti.static(range(3))])


@ti.func
def boundary_velocity(
    node, v, offset, dx, clamp_lo, clamp: ti.template(), clamp_velocity: ti.template(), planes: ti.template(), solid_lo,
    solid: ti.template(),
):  # fmt: skip
    """Velocity of the lattice's node `node` (3,) int under all conditions: planes in their order, then solids, then pins.

    Args:
        v: momentum / mass [m/s].
        offset, dx: the node is at offset + dx node [m].
        clamp_lo, clamp (a, b, c) int, clamp_velocity (a, b, c, 3): nodes whose velocity is prescribed (clamp not 0) [m/s].
        planes: (K, 8), rows of nx ny nz d kind friction 0 0; a plane holds nodes with n.x < d.
        solid_lo, solid (a, b, c, 8): kind nx ny nz friction vx vy vz at nodes; kind 0 where there is no collider.
    """
    x = place_of(node, offset, dx)
    out = v
    for k in range(planes.shape[0]):
        n = ti.Vector([planes[k, 0], planes[k, 1], planes[k, 2]])
        if n.dot(x) < planes[k, 3]:
            out = contact_velocity(out, n, ti.cast(planes[k, 4], ti.i32), planes[k, 5], ti.Vector.zero(float, 3))
    c = node - solid_lo
    if in_box(c, solid):
        kind = ti.cast(solid[c[0], c[1], c[2], 0], ti.i32)
        if kind != NONE:
            n = ti.Vector([solid[c[0], c[1], c[2], a] for a in ti.static(range(1, 4))])
            wall = ti.Vector([solid[c[0], c[1], c[2], a] for a in ti.static(range(5, 8))])
            out = contact_velocity(out, n, kind, solid[c[0], c[1], c[2], 4], wall)
    c = node - clamp_lo
    if in_box(c, clamp):
        if clamp[c[0], c[1], c[2]] != 0:
            out = ti.Vector([clamp_velocity[c[0], c[1], c[2], a] for a in ti.static(range(3))])
    return out


@ti.func
def boundary_jacobian(node, v, offset, dx, clamp_lo, clamp: ti.template(), planes: ti.template(), solid_lo, solid: ti.template()):
    """d boundary_velocity / d v, (3, 3); v is again momentum / mass. The conditions themselves are taken as constant."""
    x = place_of(node, offset, dx)
    J = ti.Matrix.identity(float, 3)
    through = v
    still = ti.Vector.zero(float, 3)
    for k in range(planes.shape[0]):
        n = ti.Vector([planes[k, 0], planes[k, 1], planes[k, 2]])
        if n.dot(x) < planes[k, 3]:
            kind = ti.cast(planes[k, 4], ti.i32)
            J = contact_jacobian(through, n, kind, planes[k, 5], still) @ J
            through = contact_velocity(through, n, kind, planes[k, 5], still)
    c = node - solid_lo
    if in_box(c, solid):
        kind = ti.cast(solid[c[0], c[1], c[2], 0], ti.i32)
        if kind != NONE:
            n = ti.Vector([solid[c[0], c[1], c[2], a] for a in ti.static(range(1, 4))])
            wall = ti.Vector([solid[c[0], c[1], c[2], a] for a in ti.static(range(5, 8))])
            J = contact_jacobian(through, n, kind, solid[c[0], c[1], c[2], 4], wall) @ J
    c = node - clamp_lo
    if in_box(c, clamp):
        if clamp[c[0], c[1], c[2]] != 0:
            J = ti.Matrix.zero(float, 3, 3)
    return J
