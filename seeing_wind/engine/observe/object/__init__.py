"""The object: from an observation to particles, material, Gaussians, surface and key points.

    relief.py     front and back of the body in picture 0        particles.py  material points between them
    keypoints.py  tracked points on the body                     control.py    what rides on what
    lifting.py    tracks to 3D, as rigid as possible             surface.py    closed mesh for display
    gaussians.py  3D Gaussians G^0                               splatting.py  their rasteriser (torch)
    ply.py        their file                                     views.py      further cameras
    pose.py       the whole body in every picture                late.py       tracks that begin later
    multiview.py  the Gaussians of several views                 covering.py   Gaussians where there are none yet
    visibility.py what a picture shows of a moving mesh          appearance.py the look over the whole clip
    contributions.py  pictures as linear in colours              look.py       the Gaussians' fit to picture 0
    block.py      plates and posts whose sides are seen          inflate.py    rounded bodies behind their front
    pins.py       what of a body is held                         finer.py      Gaussians as fine as the clip's texture
"""

from __future__ import annotations

from ...look.ply import read_ply, write_ply
from .body import build

__all__ = ["build", "read_ply", "write_ply"]
