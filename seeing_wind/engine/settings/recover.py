"""Settings of the stages *recover* and *report*: from targets to a force field, and the report on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..conventions import GRAVITY
from .option import RANGE, option

SOLVE = "the solve"
COMPARED = "other ways of solving, to compare with"


def seed_option() -> Any:
    """The seed, which all stages share."""
    return option(0, help="seed of every random choice", minimum=0, maximum=2**31 - 1, metavar="N", group=SOLVE)


@dataclass(frozen=True)
class RecoverSettings:
    """From targets to a force field."""

    gravity: tuple[float, float, float] = option(
        GRAVITY, help="known acceleration along world X, Y, Z that is not part of the field", unit="m/s²", metavar=("GX", "GY", "GZ"),
        minimum=-1e4, maximum=1e4, group=SOLVE, one_of="gravity", panel="main", typical=(-20.0, 20.0),
    )  # fmt: skip
    clamp_depth: float = 0.0
    """Clamp depth: how many grid cells (1.6 particle spacings each) below the border of the part marked as held the clamp begins."""
    stiffness: str = option(
        "free", label="Stiffness Found", help="whether the stiffness of a held body is known", group=SOLVE,
        choices={"free": "it is found with the force, where the motion shows it", "given": "it is the material's"},
    )  # fmt: skip
    body: str | None = option(
        None, label="Same Body As", metavar="DIR", group=SOLVE, folder=True,
        help="take of another recovery of the same held body, to begin with the stiffness and the clamp found there",
    )  # fmt: skip
    still: tuple[int, int] | None = option(
        None, label="Still Air", minimum=0, metavar="A:B", form=RANGE, group=SOLVE, otherwise="none", start=(0, 20),
        help="first and last frame, counted from 0 in the file, of a time in which the air is still: no force is looked for in it, and the "
        "free swing of the body shows its stiffness",
    )  # fmt: skip
    ringing: str = option(
        "found", label="Ringing", group=SOLVE,
        help="what becomes of frames in which a held body swings freely until its swing dies away",
        choices={
            "found": "they count as still air, unless --still is given or gravity makes the body sag",
            "ignored": "a force is looked for in them, as in all others",
        },
    )  # fmt: skip
    representation: str = option(
        "causal_triplane", help="how the field is stored", group=COMPARED, panel="",
        choices={
            "causal_triplane": "the paper's causal tri-plane", "kplanes": "K-Planes, over space and time",
            "point": "a vector per particle and frame, without a field between them",
        },
    )  # fmt: skip
    iterations: int = option(
        12, help="Gauss-Newton iterations of a solid at most; 1 gives a draft, with a knot every four frames", minimum=1, maximum=1000,
        metavar="N", group=SOLVE, typical=(None, 50),
    )  # fmt: skip
    schedule: str = option(
        "default", help="in which order forces are solved for", group=COMPARED, panel="",
        choices={"default": "all frames of a block together", "paper": "gradient descent frame by frame"},
    )  # fmt: skip
    objective: str = option(
        "tracking", help="what the force must explain", group=COMPARED, panel="",
        choices={
            "tracking": "tracks", "image": "the frames' pixels, with --schedule paper",
            "flow_depth": "optical flow and depth, with --schedule paper",
        },
    )  # fmt: skip
    frame_iterations: int = option(
        60, help="iterations per frame at most, with --schedule paper", minimum=1, maximum=10_000, metavar="N", group=COMPARED, panel=""
    )
    refine: int = option(
        0, minimum=0, maximum=10_000, metavar="N", group=SOLVE, typical=(None, 50),
        help="steps, at most, that refine the stored field through the simulator, so that a simulation in it strays less from the clip; "
        "0 for none, as refining takes longer than the solve",
    )  # fmt: skip
    seed: int = seed_option()


@dataclass(frozen=True)
class ReportSettings:
    """What is drawn of a recovery."""

    report: str = option(
        "quick", help="what is drawn of a recovery", group="the report", panel="",
        choices={
            "none": "nothing", "quick": "report.json, report.png and overlay.mp4",
            "full": "also resimulated.mp4, and in gaussians.ply the look fitted to the whole clip",
        },
    )  # fmt: skip
