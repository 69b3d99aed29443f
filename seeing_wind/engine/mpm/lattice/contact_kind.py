"""Kinds of contact: what happens where matter touches a collider."""

from __future__ import annotations

import numpy as np

from ...errors import UsageError
from .conditions import SEPARATE, SLIP, STICKY

KINDS = {"sticky": STICKY, "slip": SLIP, "separate": SEPARATE}


def check_kind(what: str, kind: str, friction: float) -> None:
    """Raises UsageError for an unknown kind, or a friction that is negative or not finite; `what` names the collider."""
    if kind not in KINDS:
        raise UsageError(f"The {what} is {kind!r}.", f"Choose one of {', '.join(KINDS)}.")
    if not (np.isfinite(friction) and friction >= 0.0):
        raise UsageError(f"The friction of the {what} is {friction}.", "Give a finite number that is not negative; 0 is none.")
