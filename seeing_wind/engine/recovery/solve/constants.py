"""Constants of the solve's pace: how far it looks ahead, how finely it goes, and when it has done enough."""

from __future__ import annotations

from dataclasses import dataclass

from ...conventions import constant

COST = "Cost; what it changes: docs/notebook/sensitivity.md."


@dataclass(frozen=True)
class PaceConstants:
    """Of blocks and knots; the receding horizon; Gauss-Newton; and steps of the stiffness."""

    block: int = constant(32, "frames", "Solved together, at most.", "Cost: a dense solve grows with the cube of it.")
    overlap: int = constant(8, "frames", "Of a block that the next one solves again.", "The prior's `duration`.")
    knot: float = constant(
        2.0, "frames", "Between knots of the last solves, at most; a field that changes fast gets more.", "docs/notebook/sensitivity.md."
    )
    unknowns: int = constant(1800, "unknowns", "Of a dense solve, at most; beyond them the knots get sparser.", "Cost.")
    rough: float = constant(0.5, "1", "Substeps of the rough model, in those of the fine one.", "The fine ones have a margin of three.")
    held_substeps: float = constant(
        3000.0, "1/s", "Of a held elastic body that swings far. What bends within a cell gives way a little as it crosses others, the more "
        "the longer the substeps: a reed that had swung by half its length did not unbend, and a force was found that held it so.",
        "Development scenes, docs/notebook/held_bodies.md.",
    )  # fmt: skip
    held_refined: float = constant(
        3.0, "1", "But at most so many times what its waves need: the rough model has half of these, and must be like the fine one.",
        "Chosen.",
    )  # fmt: skip
    held_far: float = constant(
        8.0, "cells", "Swings from which that is worth it, of points in 3D: pixels show nothing that small.",
        "Between development scenes: stalks that swing 5 to 7.6 cells, reeds that swing 9.5 to 20.",
    )  # fmt: skip
    haste: float = constant(3.0, "1", "How much faster than the points were seen to move the simulated body may be.", "Chosen.")

    horizon: int = constant(4, "frames", "Looked ahead.", COST)
    first_horizon: int = constant(6, "frames", "Looked ahead at first, where the initial velocity is found too.", COST)
    hop: int = constant(2, "frames", "That the body is moved on before it is looked ahead again.", COST)
    horizon_steps: int = constant(1, "steps", "Gauss-Newton steps of a look ahead.", COST)
    first_horizon_steps: int = constant(5, "steps", "Those of the first one.", COST)
    horizon_shares: tuple[float, ...] = constant(
        (1.0, 0.5, 0.0), "1", "Of the force so far, tried in turn where the body breaks down under it.", "Chosen."
    )
    horizon_unexplained: float = constant(
        0.1, "1", "Of the misfit when a look ahead begins: so much no force that stays the same for its frames explains.",
        "With none, a light card that turns by 20° a frame was squeezed by its force, not turned; 0.05 and 0.2 do as well.",
    )  # fmt: skip
    refollow_misfit: float = constant(
        3.0, "deviations", "Track misfit above which the first field of a block is found again with finer steps.",
        "Seen: 0.1 to 0.4 for leaves, posts and plants, 1.4 for a banner that turns edge-on, 6 for a flag that was lost.",
    )  # fmt: skip
    onward_iterations: int = constant(
        6, "Jacobians", "Of the fine solve of a held body's block that goes on from the one before, at most.", COST
    )
    refollow_worse: float = constant(
        1.5, "1", "The same of all targets, where it is this many times that of the motion the look-ahead led through: sparse knots may "
        "lose some of it, but not as much.", "Seen: 1.0 for a card that flutters and is found, 1.9 for one that tumbles and was lost.",
    )  # fmt: skip

    chord_steps: int = constant(6, "steps", "With one Jacobian, at most.", COST)
    stale: float = constant(0.2, "1", "A Jacobian is renewed when a step wins less than this share of what it promised.", COST)
    tolerance: float = constant(2e-3, "1", "Converged when a step promises to lower the cost by less than this share,", COST)
    tolerance_per_unknown: float = constant(
        0.02, "nats", "or by less than this per unknown.", "The cost is twice a negative log posterior: 0.14 standard deviations are left."
    )
    coarse_tolerance: float = constant(0.1, "1", "`tolerance` of a coarse solve: the fine one goes on from there.", COST)
    last_tolerance: float = constant(2e-4, "1", "`tolerance` of the last solve: its steps are cheap, as no Jacobian is missing.", COST)
    last_per_unknown: float = constant(2e-3, "nats", "`tolerance_per_unknown` of the last solve.", COST)
    evidence_tolerance: float = constant(
        0.01, "nats", "Gain in log evidence of one step at which learning ends.", "A difference of 1 is not significant."
    )

    stiffness_offsets: tuple[float, ...] = constant(
        (0.02, 0.05, 0.03, 0.03), "1, cells, 1, 1", "The difference's step of s, d, a and b.", "Smooth to a percent there."
    )
    stiffness_steps: tuple[float, ...] = constant((0.4, 0.5, 0.2, 0.2), "1, cells, 1, 1", "Largest step of each at a time.", "Chosen.")
    stiffness_shares: tuple[float, ...] = constant(
        (1.0, 0.5, 0.25, 0.125), "1", "Of a joint step, tried in turn until one lowers the cost: where a body buckles it is far from what "
        "the step takes it for.", "Chosen.",
    )  # fmt: skip
    stiffness_kept: float = constant(
        0.25, "1", "Of these largest steps: a Jacobian is renewed where the body has changed by more since it was taken.", "Chosen."
    )
    stiffness_settled: float = constant(
        0.25, "deviations", "Steps of the stiffness below this need no other after them.", "Chosen."
    )
    stiffness_coarse_rounds: int = constant(5, "rounds", "Joint steps after the coarse solve, at most.", COST)
    stiffness_fine_rounds: int = constant(2, "rounds", "Joint steps after the fine solve, at most.", COST)
    stiffness_following: int = constant(
        3, "steps", "Times that a step of the stiffness is looked at, with a chord step of the force before each but the first: the force "
        "follows a clamp only about linearly, and would be blamed on the stiffness.", "Chosen.",
    )  # fmt: skip
    stiffness_lost: float = constant(
        2.0, "deviations", "Track misfit above which a solve says nothing of the stiffness: what it misses is no small error about the "
        "right motion.", "Seen: below 0.5 for posts, 1.4 for a banner that turns edge-on.",
    )  # fmt: skip


PACE = PaceConstants()
