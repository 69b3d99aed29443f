"""What the object looks like: 3D Gaussians that move with its particles. Forces do not depend on any of it.

    gaussians.py        the Gaussians of frame 0 and how they deform    first_frame.py    their fit to frame 0 of all views
    splatting.py        their rasteriser (torch)                        ply.py            their file
    over_clip.py        their fit to the whole clip                     contributions.py  a frame as a linear map of the colours
    harmonics.py        colours that depend on the direction            finer.py          Gaussians as fine as the clip's texture
    covering.py         Gaussians for surface that has none yet
    report/             report.json, report.png, overlay.mp4, resimulated.mp4
"""

from .first_frame import dress
from .ply import write_ply

__all__ = ["dress", "write_ply"]
