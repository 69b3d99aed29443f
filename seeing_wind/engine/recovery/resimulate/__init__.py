"""Re-simulation: the bodies of an edit, with their pins and masses, moved by a recovered field.

    simulate.py  simulates an edit            actors.py     the bodies of an edit before the simulation
    mesh.py      triangle meshes from files
    fill.py      particles for a mesh         voxels.py     the inside of a surface that is not a proper solid
    pins.py      pinned vertices              obstacles.py  the colliders of an edit
    sheets.py    open meshes as shells        in_field.py   field, gravity and colliders around the bodies
    forces.py    further forces on a lattice  coarser/      fewer particles or vertices, for a preview
"""

from .mesh import load_mesh
from .simulate import Simulated, simulate_bodies

__all__ = ["Simulated", "load_mesh", "simulate_bodies"]
