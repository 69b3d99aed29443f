"""The grid: where its nodes lie, which of them are held, and what stands in the way.

    boundary.py         the clamp of a pinned body          kinematics.py  a clamp that moves
    conditions.py       what a node's velocity becomes      grid_force.py  a force prescribed at nodes
    colliders.py        planes, rooms and closed meshes     signed_distance.py, closed_mesh.py  their geometry
"""
