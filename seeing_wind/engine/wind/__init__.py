"""Wind: what air that moves at u(x, t) [m/s] does to a surface that moves at v, and which u made a body move as it did.

    drag.py      the force of air on faces and on vertices      surface.py   where the air has hold of a body
"""

from .drag import AIR, DragLaw, area_normals, face_forces, vertex_drag

__all__ = ["AIR", "DragLaw", "area_normals", "face_forces", "vertex_drag"]
