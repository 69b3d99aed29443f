"""The grid: where its nodes lie, which of them are held, and what stands in the way.

    boundary.py         the clamp of a pinned body          kinematics.py  clamps and colliders that move
    conditions.py       what a node's velocity becomes
    colliders.py        planes, and all together            mesh_collider.py  closed meshes, also those that move
    signed_distance.py, closed_mesh.py                      the geometry of meshes
    beside.py           what places do beside points that move
"""
