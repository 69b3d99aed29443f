"""Whether a held body already bears its weight in the shape that frame 0 shows.

A plant, a twig or a sign has long come to rest under its weight when it is filmed: its shape in frame 0 is not the one without a load.
A body that the solver starts in this shape without strain would sag at once. So if gravity is known, the first frames are compared with
that sag. If the sag does not show, the body bears its weight, and the force is what moves it away from its shape in frame 0.
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
    """Whether a held body bears its weight in the shape x (N, 3) [m] of frame 0: the first frames do not show it sag as one without strain
    would.

    A velocity in frame 0 is no evidence, so the part that grows linearly with time is removed from both motions. If the sag would be too
    small to be seen, the body is taken to bear its weight, as nearly all filmed bodies do.
    """
    frames = min(NOISE.sag_frames, objective.frames)
    if frames < 2:
        return True
    rough = replace(model, substeps=max(1, model.substeps // 2))
    try:
        sagging = rollout(rough, State.at_rest(x), np.zeros((frames, *x.shape))).x
    except SimulationError:
        return True  # a body that breaks under its own weight could not stand, so it must bear it already
    still = np.broadcast_to(x, sagging.shape)
    raw = objective.until(frames).residual(np.stack([still, sagging]))[:, 1:]  # (2, frames, channels)
    raw /= objective.deviation[1 : frames + 1]
    even = np.arange(1.0, frames + 1.0) / np.linalg.norm(np.arange(1.0, frames + 1.0))
    bent = raw - even[:, None] * np.einsum("t,btc->bc", even, raw)[:, None]
    seen, sag = -bent[0], bent[1] - bent[0]
    expected = float((sag**2).sum())
    return expected < NOISE.sag_seen**2 or float((seen * sag).sum()) < 0.5 * expected
