"""Meshes in, bodies out: what a user inserts, pins and weighs, moved by a recovered field.

    simulate.py  an edit becomes motion       actors.py     its bodies before they move
    mesh.py      triangle meshes from files
    fill.py      particles for a mesh         voxels.py     the inside of a surface that is no proper solid
    pins.py      pinned vertices              obstacles.py  what the bodies run into
    sheets.py    open meshes as shells        in_field.py   what is around the bodies
    forces.py    further forces on a lattice  coarser/      less to simulate, for a preview
"""

from .mesh import load_mesh
from .simulate import Simulated, simulate_bodies

__all__ = ["Simulated", "load_mesh", "simulate_bodies"]
