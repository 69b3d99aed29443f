"""The grid: where its nodes lie, which of them are held, and the colliders.

    boundary.py         the clamp of a pinned body          kinematics.py     clamps and colliders that move
    conditions.py       the boundary conditions of a node's velocity
    colliders.py        planes; all colliders on a lattice  mesh_collider.py  closed meshes, still or moving
    signed_distance.py, closed_mesh.py                      the geometry of meshes
    beside.py           the motion of places next to points that move
"""
