"""Wind: the force that air moving at u(x, t) [m/s] exerts on a moving surface, and the wind u that explains how a body moved.

    drag.py      the drag law on faces and on vertices          felt.py      a recovered force as an observation of the air
    surface.py   the surface of a body that the air acts on     estimate.py  the most probable wind
    motion.py    simulating bodies in a wind                    verdict.py   whether a wind is plausible, and how strong it is
    sheet/       the wind on a thin sheet                       stage.py     the stage *wind* of a take
    together.py  several bodies as observations of one wind     joined.py    that wind, written to the take of each
"""

from .drag import area_normals, face_forces, vertex_drag

__all__ = ["area_normals", "face_forces", "vertex_drag"]
