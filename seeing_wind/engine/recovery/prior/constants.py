"""Constants of the prior: what is assumed about the force, a held body and the initial velocity before the clip is seen."""

from __future__ import annotations

from dataclasses import dataclass

from ...conventions import constant

WEAK = "Weak: the evidence moves it."
SCENES = "Development scenes, docs/notebook."


@dataclass(frozen=True)
class PriorConstants:
    """Constants of `kernel`, `evidence`, `stretch` and `basis`; of a held body's stiffness and clamp; and of the beginning of a clip."""

    length: float = constant(2.0, "body radii", "Median of the correlation length L.", WEAK)
    length_spread: float = constant(1.0, "1", "Standard deviation of log L.", WEAK)
    duration: float = constant(8.0, "frames", "Median of the correlation time tau.", WEAK)
    duration_spread: float = constant(0.5, "1", "Standard deviation of log tau.", WEAK)
    uniform: float = constant(0.5, "1", "Median of u, the variance of the uniform part relative to the nonlinear part.", WEAK)
    slope: float = constant(
        0.2, "1", "Median of w, the variance of the linear part one body radius from the centre, relative to the nonlinear part.", WEAK
    )
    part_spread: float = constant(1.5, "1", "Standard deviation of log u and log w.", WEAK)
    steady: float = constant(0.5, "1", "c: variance of the part that is constant in time, relative to the varying part.", "Chosen.")
    component_spread: float = constant(
        1.0, "1", "Standard deviation of the logarithm of each component's size, and of the correlations.", WEAK
    )
    component_floor: float = constant(
        0.02, "1", "Share of the variance that always has the shape assumed beforehand, so that no direction is ruled out.", "Chosen."
    )
    stretch: float = constant(
        0.1, "1", "Standard deviation of the field's symmetric gradient under one camera, relative to that without the stretch penalty. "
        "For bodies that flow, also of its trace, as errors of a guessed shape and a coarse grid look like a pressure from all sides.",
        SCENES,
    )  # fmt: skip
    loose_stretch: float = constant(
        0.3, "1", "The same where stretch must be expected: for bodies that flow, under one camera; and, unless the evidence rejects it, "
        "with 3D points or several cameras, where noise hides a stretch.",
        "With less, a squeezed ball was taken for one that moves in depth.",
    )  # fmt: skip
    stretch_log_odds: float = constant(
        20.0, "nats", "Prior log odds in favour of the stretch penalty.",
        "With noisy points the evidence differs by a few units; where the penalty is wrong, by hundreds.",
    )  # fmt: skip
    stretch_degree: int = constant(
        1, "degree", "Highest degree of the smooth functions with which the gradient is averaged.", "Chosen."
    )
    stretch_flat: float = constant(
        0.25, "1", "Axes shorter than this share of the longest are left out: stretching along them has no visible effect.", "Chosen."
    )
    max_degree: int = constant(
        5, "degree", "Highest degree of the polynomials.", "A plate fills 16 modes with degree 4 to 5, a solid ball with degree 3."
    )
    thin: float = constant(
        0.1, "1", "No functions vary along an axis along which the spread of the mass is below this share of that along the longest axis. "
        "They would add nothing to the motion: a torque on a plate is equivalent to a normal force that varies along it.", "Chosen.",
    )  # fmt: skip
    axis: float = constant(
        0.1, "body radii", "Smallest distance between the centres of the pinned and the free part for which a body has an axis.", "Chosen."
    )
    full_modes: int = constant(16, "modes", "Most modes.", "Cost; docs/notebook/sensitivity.md.")
    fewest_modes: int = constant(4, "modes", "Fewest modes: a uniform force and its slope.", "Geometry.")
    particles_a_mode: int = constant(
        16, "particles", "Fewest particles per mode, for a body whose few particles represent thinner things: variation within a few "
        "particles does not show.", "Chosen.",
    )  # fmt: skip
    observable: float = constant(
        0.1, "1", "A mode is used if, of a mode of unit size, the observed points show at least this share that the modes before it do not "
        "explain.", "Chosen.",
    )  # fmt: skip
    unexpected: float = constant(
        1e-4, "1", "Largest share of the field's variance over the body in modes that a solve leaves out.", "Chosen."
    )
    between_knots: float = constant(
        1e-3, "1", "Largest share of the field's variance along the body's path that straight lines between knots may miss; above it, "
        "knots become denser.", "With knots in every second frame they miss more for cards and a spinning banner, for which denser "
        "ones are better, and less for stalks and a sheet.",
    )  # fmt: skip

    stiffness_spread: float = constant(
        0.3, "1", "Standard deviation of s = log(E / E given).", "A guessed thickness alone causes as much."
    )
    stiffness_told: float = constant(
        0.5, "1", "The clip determines the stiffness if the posterior deviation is at most this share of the prior's; otherwise the given "
        "stiffness stays.", "Chosen.",
    )  # fmt: skip
    clamp_spread: float = constant(
        0.5, "cells", "Standard deviation of d, by which the clamp begins deeper.", "What is painted is uncertain by about a particle."
    )
    section_spread: float = constant(
        0.2, "1", "Standard deviation of a and b, the amplitudes of the section's shapes.",
        "For a square with one side 8 % longer than the other, a is as large.",
    )  # fmt: skip
    section_seen: float = constant(
        0.05, "1", "The same for a body whose particles are the points that were followed: its section is not guessed.",
        "Second moments of a thousand particles placed at random differ by as much; another simulator's posts that move by the true force "
        "have 0.000 to 0.014, and one of eight 0.04.",
    )  # fmt: skip
    later_optimism: float = constant(
        1.7, "1", "For a held body seen as 3D points: error of the force relative to its posterior deviation in all blocks but the first, "
        "as these take the state at their start for exact.",
        "Development scenes, exact points, 4 s: median of six posts 1.6; in their first blocks 1.1.",
    )  # fmt: skip
    section_farthest: float = constant(
        2.0, "1", "Limit of the section's shape functions: beyond the section's corners, on leaves far off a stem, they have no meaning.",
        "Geometry.",
    )  # fmt: skip
    body_anew: tuple[float, ...] = constant(
        (0.03, 0.1, 0.05, 0.05), "1, cells, 1, 1", "Standard deviations of s, d, a and b that are added to those of the fit if the body is "
        "built again from another clip, as its mask differs.", "Chosen.",
    )  # fmt: skip

    slowest: float = constant(
        0.03, "m/s", "Smallest standard deviation of the initial velocity; larger if the first frames show more.", "Chosen."
    )
    unseen_spin: float = constant(
        1e-3, "1", "Prior size of the initial spin of a body that is seen as a point, relative to the one that its speed suggests: the "
        "spin does not show, and a track a little off the centre of mass would set the body spinning.", "Chosen.",
    )  # fmt: skip
    axial_shrink: float = constant(
        0.2, "1", "Size of the force along a held body, relative to across it: it hardly shows, and it absorbs the error of the clamp.",
        SCENES,
    )  # fmt: skip
    ray_shrink: float = constant(0.03, "1", "The same along the view, for a body that one camera sees as a point.", "Chosen.")
    jump: float = constant(
        0.5, "1", "Standard deviation of the field's change from frame to frame while following, relative to its expected size.", "Chosen."
    )
    strain: float = constant(
        0.2, "1", "Standard deviation of the force's symmetric gradient while following, relative to that without a penalty.", "Chosen."
    )


PRIOR = PriorConstants()
