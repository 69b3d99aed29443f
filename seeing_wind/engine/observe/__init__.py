"""From a clip to an `Observation`, and from that to a body. OpenCV lives here.

    observation.py   the whole stage                 networks.py  the choice between networks and defaults
    steady.py        lens, shake and background      outline.py   the object in frame 0
    working_size.py  large clips in a smaller copy   following.py the object's masks and tracks through the clip
    given.py         checks the user's files
    clip/    frames, camera, depth                   mask/    the object's outline
    tracks/  tracks of its points                    models/  optional networks, called by `networks`
    preview/ pictures of an observation, and verdicts on it
    object/  particles, surface and key points: what the solver moves
"""

from .observation import observe, pinned

__all__ = ["observe", "pinned"]
