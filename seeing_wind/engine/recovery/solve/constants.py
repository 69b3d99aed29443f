"""Constants of the solve: how far it looks ahead, how finely it resolves, and when it stops."""

from __future__ import annotations

from dataclasses import dataclass

from ...conventions import constant

COST = "Cost; what it changes: docs/notebook/sensitivity.md."


@dataclass(frozen=True)
class PaceConstants:
    """Blocks and knots; the receding horizon; Gauss-Newton; and steps of the stiffness."""

    block: int = constant(32, "frames", "Most frames that are solved together.", "Cost: a dense solve grows with the cube of it.")
    overlap: int = constant(8, "frames", "Frames of a block that the next one solves again.", "The prior's `duration`.")
    knot: float = constant(
        2.0, "frames", "Largest distance between knots in the last solves; a field that changes fast gets denser knots.",
        "docs/notebook/sensitivity.md.",
    )  # fmt: skip
    unknowns: int = constant(1800, "unknowns", "Most unknowns of a dense solve; to stay below, knots become sparser.", "Cost.")
    rough: float = constant(0.5, "1", "Substeps of the rough model, relative to the fine one.", "The fine model has a margin of three.")
    held_substeps: float = constant(
        3000.0, "1/s", "Substeps of a held elastic body that swings far. A bend within a cell relaxes a little as it crosses others, and "
        "more with longer substeps: a reed that had swung by half its length did not unbend, and the force found was one that held it so.",
        "Development scenes, docs/notebook/held_bodies.md.",
    )  # fmt: skip
    held_refined: float = constant(
        3.0, "1", "Upper limit of these, relative to the substeps that the body's waves need: the rough model has half of these, and must "
        "resemble the fine one.", "Chosen.",
    )  # fmt: skip
    held_far: float = constant(
        8.0, "cells", "Smallest swing for which those substeps are used, and only with 3D points: pixels do not show so small an effect.",
        "Between development scenes: stalks that swing 5 to 7.6 cells, reeds that swing 9.5 to 20.",
    )  # fmt: skip
    haste: float = constant(3.0, "1", "Largest speed of the simulated body, relative to that of the observed points.", "Chosen.")

    horizon: int = constant(4, "frames", "Length of the look-ahead.", COST)
    first_horizon: int = constant(6, "frames", "Length of the first look-ahead, which also finds the initial velocity.", COST)
    hop: int = constant(2, "frames", "Frames by which the body is advanced between look-aheads.", COST)
    horizon_steps: int = constant(1, "steps", "Gauss-Newton steps in a look-ahead.", COST)
    first_horizon_steps: int = constant(5, "steps", "Gauss-Newton steps in the first look-ahead.", COST)
    horizon_shares: tuple[float, ...] = constant(
        (1.0, 0.5, 0.0), "1", "Shares of the force so far, tried in turn if the body breaks down under it.", "Chosen."
    )
    horizon_unexplained: float = constant(
        0.1, "1", "Share of the misfit at the start of a look-ahead that no force which is constant over its frames can explain.",
        "With 0, a light card that turns by 20° per frame was squeezed by its force, not turned; 0.05 and 0.2 do as well.",
    )  # fmt: skip
    refollow_misfit: float = constant(
        3.0, "deviations", "Track misfit above which the first field of a block is found again at a finer pace.",
        "Seen: 0.1 to 0.4 for leaves, posts and plants, 1.4 for a banner that turns edge-on, 6 for a flag that was lost.",
    )  # fmt: skip
    onward_iterations: int = constant(
        6, "Jacobians", "Most Jacobians of the fine solve of a held body's block that continues from the one before.", COST
    )
    refollow_worse: float = constant(
        1.5, "1", "The first field is also found again if the misfit of all targets exceeds that of the motion found by the look-ahead by "
        "this factor: with sparse knots it may be larger, but not by so much.",
        "Seen: 1.0 for a card that flutters and is found, 1.9 for one that tumbles and was lost.",
    )  # fmt: skip

    chord_steps: int = constant(6, "steps", "Most chord steps with one Jacobian.", COST)
    stale: float = constant(0.2, "1", "A Jacobian is renewed when a step lowers the cost by less than this share of its prediction.", COST)
    tolerance: float = constant(2e-3, "1", "A solve has converged when a step promises to lower the cost by less than this share.", COST)
    tolerance_per_unknown: float = constant(
        0.02, "nats", "A solve has also converged when a step promises to lower the cost by less than this per unknown.",
        "The cost is twice a negative log posterior: 0.14 standard deviations are left.",
    )  # fmt: skip
    coarse_tolerance: float = constant(0.1, "1", "`tolerance` of a coarse solve, which the fine one continues.", COST)
    last_tolerance: float = constant(2e-4, "1", "`tolerance` of the last solve: its steps are cheap, as it begins with a Jacobian.", COST)
    last_per_unknown: float = constant(2e-3, "nats", "`tolerance_per_unknown` of the last solve.", COST)
    evidence_tolerance: float = constant(
        0.01, "nats", "Learning ends when a step gains less than this in log evidence.", "A difference of 1 is not significant."
    )

    stiffness_offsets: tuple[float, ...] = constant(
        (0.02, 0.05, 0.03, 0.03), "1, cells, 1, 1", "Finite-difference steps of s, d, a and b.", "Smooth to a percent there."
    )
    stiffness_steps: tuple[float, ...] = constant((0.4, 0.5, 0.2, 0.2), "1, cells, 1, 1", "Largest steps of s, d, a and b.", "Chosen.")
    stiffness_shares: tuple[float, ...] = constant(
        (1.0, 0.5, 0.25, 0.125), "1", "Shares of a joint step, tried in turn until one lowers the cost: a body that buckles is far from "
        "the step's linear model.", "Chosen.",
    )  # fmt: skip
    stiffness_kept: float = constant(
        0.25, "1", "A Jacobian is renewed if the stiffness has changed by more than this share of these largest steps since.", "Chosen."
    )
    stiffness_settled: float = constant(
        0.25, "deviations", "Joint steps end when the stiffness changes by less than this.", "Chosen."
    )
    stiffness_coarse_rounds: int = constant(5, "rounds", "Most joint steps after the coarse solve.", COST)
    stiffness_fine_rounds: int = constant(2, "rounds", "Most joint steps after the fine solve.", COST)
    stiffness_following: int = constant(
        3, "steps", "Evaluations of each share of a joint step, with a chord step of the force before each but the first: the force "
        "depends on the clamp only roughly linearly, and the remainder would be attributed to the stiffness.", "Chosen.",
    )  # fmt: skip
    stiffness_lost: float = constant(
        2.0, "deviations", "Track misfit above which no joint step is taken: the solution is then too far from the right motion to say "
        "anything about the stiffness.", "Seen: below 0.5 for posts, 1.4 for a banner that turns edge-on.",
    )  # fmt: skip


PACE = PaceConstants()
