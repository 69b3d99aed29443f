"""Whether a held body bears its weight in the shape that frame 0 shows.

A plant, a twig or a sign has long come to rest under its weight when it is filmed: its shape in frame 0 is not the one that it would have
without a load. A body that the solver puts there unstrained would sag at once. So where gravity is known, what is seen of the first frames
is compared with that sag. If it is not there, the weight is borne, and the force is what moves the body from where it stands.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import SimulationError
from ...mpm.model import Model
from ...mpm.rollout import rollout
from ...mpm.state import State
from .constants import NOISE
from .objective import Objective


def bears_weight(model: Model, x: np.ndarray, objective: Objective) -> bool:
    """Whether a body that is held at x (N, 3) [m], as frame 0 shows it, does not sag as one without a load would.

    A velocity in frame 0 tells nothing, so what grows evenly with time is left out of both. Where the sag is too small to be seen, the
    weight is borne: so it is of nearly all that is filmed.
    """
    frames = min(NOISE.sag_frames, objective.frames)
    if frames < 2:
        return True
    rough = replace(model, substeps=max(1, model.substeps // 2))
    try:
        sagging = rollout(rough, State.at_rest(x), np.zeros((frames, *x.shape))).x
    except SimulationError:
        return True  # no body stands that breaks under its own weight
    still = np.broadcast_to(x, sagging.shape)
    raw = objective.until(frames).residual(np.stack([still, sagging]))[:, 1:]  # (2, frames, channels)
    raw /= objective.deviation[1 : frames + 1]
    even = np.arange(1.0, frames + 1.0) / np.linalg.norm(np.arange(1.0, frames + 1.0))
    bent = raw - even[:, None] * np.einsum("t,btc->bc", even, raw)[:, None]
    seen, sag = -bent[0], bent[1] - bent[0]
    expected = float((sag**2).sum())
    return expected < NOISE.sag_seen**2 or float((seen * sag).sum()) < 0.5 * expected
