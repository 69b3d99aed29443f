"""Shells: cloth, leaves and paper as triangle meshes without a thickness of their own, moved by large implicit substeps.

    surface.py   the mesh, and which meshes are refused  membrane.py  stretching, and folds finer than the mesh
    slopes.py    slopes across edges                     bending.py   curvature of faces, and its energy
    forces.py    the forces of all faces                 face_kernels.py  the same, compiled
    model.py     a sheet with mass and pins; its state   substep.py   one substep: backward differences and Newton's method
    rollout.py   a frame of substeps                     linear/      the linear equations
    contact.py   vertices against planes; friction       obstacle.py  colliders, as planes for the vertices
    compiled.py  launchers of kernels, and index lists for them

See docs/reference/shells.md.
"""

from .model import Shell, State, at_rest, shell_of
from .obstacle import obstacles_of
from .rollout import advance_frame, substeps_for
from .substep import Load, advance
from .surface import surface_of

__all__ = ["Load", "Shell", "State", "advance", "advance_frame", "at_rest", "obstacles_of", "shell_of", "substeps_for", "surface_of"]
