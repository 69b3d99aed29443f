"""Motion from each frame of a clip to the next, found in one pass over it and used again in the next."""

from __future__ import annotations

import contextlib
import tempfile
import weakref
from collections.abc import Callable

import numpy as np

from .motion import Flow, FlowSolver, Window


class Flows:
    """What a pass over smaller frames found, for one over the frames themselves: there it would be sought as coarsely.

    The motion is kept in a temporary file, so that a clip's length costs no memory. What is not there, because the disk is full or an
    interrupted run found it, is found once more, the same.
    """

    def __init__(self, gray: Callable[[int], np.ndarray], larger: tuple[float, float]) -> None:
        """`gray` gives the smaller frames (H, W) uint8 by their number; the others are `larger` by these factors along x and y."""
        self._gray, self._larger, self._solver = gray, larger, FlowSolver(rough=True)
        self._asked: list[np.ndarray] = []
        self._found: dict[int, tuple[int, tuple[int, ...]]] = {}
        self._file = tempfile.TemporaryFile(prefix="seeing_wind_")
        weakref.finalize(self, self._file.close)

    def add(self, flow: Flow | None, window: Window, shift: np.ndarray) -> None:
        """Motion to the next frame, in `window` and round `shift` (2,) [px], of the smaller ones; None where the object is hidden."""
        if flow is not None:
            with contextlib.suppress(OSError):
                place = self._file.seek(0, 2)
                self._file.write(np.ascontiguousarray(flow.motion).data)
                self._found[len(self._asked)] = place, flow.motion.shape
        self._asked.append(np.full(6, np.nan) if flow is None else np.array([*window, *shift]))

    def state(self) -> dict[str, np.ndarray]:
        """Where motion was sought: all that finding it once more needs."""
        return {"flows": np.reshape(self._asked, (-1, 6))}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Go on as what gave `state` would have."""
        self._asked = list(state["flows"])

    def covering(self, t: int, window: Window) -> Flow | None:
        """Motion from frame t to the next one, of the larger frames; None where it was not sought in all of `window`."""
        if np.isnan(self._asked[t]).any():
            return None
        x0, y0, x1, y1 = (int(value) for value in self._asked[t][:4])
        if t in self._found:
            place, shape = self._found[t]
            self._file.seek(place)
            motion = np.frombuffer(self._file.read(8 * shape[0] * shape[1]), np.float32).reshape(shape)
            flow = Flow(x0, y0, motion, ((x1 - x0) / shape[1], (y1 - y0) / shape[0]))
        else:
            flow = self._solver.between(self._gray(t), self._gray(t + 1), (x0, y0, x1, y1), self._asked[t][4:])
        larger = flow.enlarged(*self._larger)
        return larger if larger.covers(window) else None
