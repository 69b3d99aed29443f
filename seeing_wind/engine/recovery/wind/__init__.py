"""Wind: what air that moves at u(x, t) [m/s] does to a surface that moves at v, and which u made a body move as it did.

    drag.py      the force of air on faces and on vertices      felt.py      a recovered force as an observation of the air
    surface.py   where the air has hold of a body               estimate.py  the most probable wind
    motion.py    bodies in a wind, part of a frame at a time    verdict.py   whether it is one, and how strong
    sheet/       what moved a thin sheet                        stage.py     the wind of a take
    together.py  what several bodies felt of one wind           joined.py    that wind, in the takes of all
"""

from .drag import area_normals, face_forces, vertex_drag

__all__ = ["area_normals", "face_forces", "vertex_drag"]
