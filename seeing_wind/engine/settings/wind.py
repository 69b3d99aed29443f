"""Settings of the stage *wind*: how a recovered force is read."""

from __future__ import annotations

from dataclasses import dataclass

from .option import option
from .recover import SOLVE


@dataclass(frozen=True)
class WindSettings:
    """A body force, or a wind that makes it."""

    field: str = option(
        "force", help="how the recovered force is read", group=SOLVE, panel="",
        choices={
            "force": "a body force in N/m³", "wind": "the velocity of the air in m/s that makes it, by a drag law",
            "auto": "what is more probable",
        },
    )  # fmt: skip
