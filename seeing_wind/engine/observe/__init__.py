"""From a clip to an `Observation`, and from that to a body. OpenCV lives here.

    observation.py   the whole stage                 networks.py  where a network takes the place of a default
    steady.py        lens, shake and background      outline.py   the object in frame 0
    working_size.py  large clips in a smaller copy   following.py the object's masks and tracks through the clip
    clip/    frames, camera, depth                   mask/    the object's outline
    tracks/  where its points go                     models/  optional networks, behind `networks`
    preview/ what was seen, drawn and judged
    object/  particles, surface and key points: what the solver moves
"""

from .observation import observe, pinned

__all__ = ["observe", "pinned"]
