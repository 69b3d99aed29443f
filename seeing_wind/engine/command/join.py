"""The verb *join*: one wind for the objects of several takes."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from typing import Any

from ..progress import Progress
from ..record_arrays import require_take
from .lock import held


def join(arguments: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """`join DIR DIR ...`: recover one wind for all these takes, and write it into each of them."""
    from ..recovery.wind.joined import join_winds

    with ExitStack() as stack:
        takes = [stack.enter_context(held(require_take(path), arguments.verb, progress)) for path in dict.fromkeys(arguments.takes)]
        told = join_winds(takes, progress)
    return {"outcome": "converged", "takes": [str(take.path) for take in takes], "wind": told}
