"""Settings of the stage *wind*: how a recovered force is interpreted."""

from __future__ import annotations

from dataclasses import dataclass

from .option import option
from .recover import SOLVE


@dataclass(frozen=True)
class WindSettings:
    """Whether the result is a body force, or the wind that causes it."""

    field: str | None = option(
        None, help="how the recovered force is read", group=SOLVE, panel="main", titles={"wind": "Wind Velocity", "auto": "Automatic"},
        otherwise="suits the body: wind for a thin sheet, else force",
        choices={
            "force": "a body force in N/m³, for whatever moved the object: hands, water, magnets, air",
            "wind": "the velocity of the air in m/s that causes it by a drag law: for what the wind blew, to blow other things with it",
            "auto": "the wind where it is more probable, else the force: when it is not known what moved the object",
        },
    )  # fmt: skip
