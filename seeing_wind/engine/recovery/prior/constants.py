"""Constants of the prior: what is believed of the force, of a held body and of the initial velocity before the clip is seen."""

from __future__ import annotations

from dataclasses import dataclass

from ...conventions import constant

WEAK = "Weak: the evidence moves it."
SCENES = "Development scenes, docs/notebook."


@dataclass(frozen=True)
class PriorConstants:
    """Of `kernel`, `evidence`, `stretch` and `basis`; then of a held body's stiffness and clamp; then of where a clip begins."""

    length: float = constant(2.0, "body radii", "Median of the correlation length L.", WEAK)
    length_spread: float = constant(1.0, "1", "Standard deviation of log L.", WEAK)
    duration: float = constant(8.0, "frames", "Median of the correlation time tau.", WEAK)
    duration_spread: float = constant(0.5, "1", "Standard deviation of log tau.", WEAK)
    uniform: float = constant(0.5, "1", "Median of u, the variance of the uniform part relative to the nonlinear part.", WEAK)
    slope: float = constant(0.2, "1", "Median of w, that of the linear part one body radius from the centre.", WEAK)
    part_spread: float = constant(1.5, "1", "Standard deviation of log u and log w.", WEAK)
    steady: float = constant(0.5, "1", "c: variance of the part that is constant in time, relative to the varying part.", "Chosen.")
    component_spread: float = constant(
        1.0, "1", "Standard deviation of the logarithm of each component's size, and of the correlations.", WEAK
    )
    component_floor: float = constant(
        0.02, "1", "Share of the variance that keeps the shape given beforehand, so that no direction is ruled out.", "Chosen."
    )
    stretch: float = constant(
        0.1, "1", "Standard deviation of the field's symmetric gradient under one camera, relative to that without the stretch "
        "penalty; and of its trace for bodies that flow, as errors of a guessed shape and a coarse grid look like a pressure from all "
        "sides.", SCENES,
    )  # fmt: skip
    loose_stretch: float = constant(
        0.3, "1", "The same where stretch is to be expected: of bodies that flow, under one camera; and with 3D points or several cameras, "
        "as noise hides a stretch, unless the evidence rejects it.", "With less, a squeezed ball was taken for one that moves in depth.",
    )  # fmt: skip
    stretch_log_odds: float = constant(
        20.0, "nats", "Prior log odds of the stretch belief.",
        "With noisy points the evidence differs by a few units; against a wrong belief, by hundreds.",
    )  # fmt: skip
    stretch_degree: int = constant(1, "degree", "Highest one of the smooth functions against which the gradient is tested.", "Chosen.")
    stretch_flat: float = constant(
        0.25, "1", "Axes shorter than this share of the longest are left out: stretching along them has no visible effect.", "Chosen."
    )
    max_degree: int = constant(
        5, "degree", "Highest polynomial tried.", "A plate fills 16 modes with degree 4 to 5, a solid ball with degree 3."
    )
    thin: float = constant(
        0.1, "1", "An axis along which the mass spreads less than this share of what it does along the longest gets no functions. They "
        "would move nothing that the others do not: a torque across a plate is a normal force that varies along it.", "Chosen.",
    )  # fmt: skip
    axis: float = constant(
        0.1, "body radii", "Least distance between the middles of what is held and what is not, from which a body has an axis.", "Chosen."
    )
    full_modes: int = constant(16, "modes", "At most.", "Cost; docs/notebook/sensitivity.md.")
    fewest_modes: int = constant(4, "modes", "A uniform force and its slope, in any case.", "Geometry.")
    particles_a_mode: int = constant(
        16, "particles", "A body whose few particles stand for thinner things has no more modes than one for so many of them: what varies "
        "within a few particles, they do not show.", "Chosen.",
    )  # fmt: skip
    observable: float = constant(
        0.1, "1", "A mode is used when the observed points see at least this share of it that the modes before it do not explain.",
        "Chosen.",
    )  # fmt: skip
    unexpected: float = constant(
        1e-4, "1", "Share of the field's variance over the body that may lie in modes which a solve leaves out.", "Chosen."
    )
    between_knots: float = constant(
        1e-3, "1", "Share of the field's variance along the body's path that straight lines between knots may miss before they get denser.",
        "In every second frame they miss more for cards and a spinning banner, which gain by denser ones; less for stalks and a sheet.",
    )  # fmt: skip

    stiffness_spread: float = constant(
        0.3, "1", "Standard deviation of s = log(E / E given).", "A guessed thickness alone makes as much."
    )
    stiffness_told: float = constant(
        0.5, "1", "The clip tells the stiffness when it leaves at most this share of its spread; otherwise the one given stays.", "Chosen."
    )
    clamp_spread: float = constant(
        0.5, "cells", "Standard deviation of d, by which the clamp begins deeper.", "What is painted is uncertain by about a particle."
    )
    section_spread: float = constant(
        0.2, "1", "Standard deviation of a and b, sizes of the section's shapes.",
        "A square with one side 8 % longer than the other has an a of as much.",
    )  # fmt: skip
    section_seen: float = constant(
        0.05, "1", "The same of a body whose particles are the points that were followed: its section is not guessed.",
        "Second moments of a thousand particles placed at random differ by as much; another simulator's posts that move by the true force "
        "have 0.000 to 0.014, and one of eight 0.04.",
    )  # fmt: skip
    later_optimism: float = constant(
        1.7, "1", "Errors of the force on a held body that points in 3D show, over its posterior's deviation, in all blocks but the first: "
        "they take the state at their start for exact.",
        "Development scenes, exact, 4 s: in the median of six posts 1.6; in their first blocks 1.1.",
    )  # fmt: skip
    section_farthest: float = constant(
        2.0, "1", "Largest size of a shape of the section: beyond its corners, on leaves far off a stem, it says nothing.", "Geometry."
    )
    body_anew: tuple[float, ...] = constant(
        (0.03, 0.1, 0.05, 0.05), "1, cells, 1, 1", "Standard deviations of s, d, a and b that a body built anew from another clip adds "
        "to the fit's own: another clip has another mask.", "Chosen.",
    )  # fmt: skip

    slowest: float = constant(
        0.03, "m/s", "Least standard deviation of the initial velocity; more when the first frames show more.", "Chosen."
    )
    unseen_spin: float = constant(
        1e-3, "1", "Prior size of the initial spin of a body that is seen as a point, relative to the one that its speed suggests: nothing "
        "tells of it, and a track a little off the centre of mass would set it turning.", "Chosen.",
    )  # fmt: skip
    axial_shrink: float = constant(
        0.2, "1", "Size of the force along a held body, relative to across it: hardly seen, and it soaks up the error of the clamp.", SCENES
    )
    ray_shrink: float = constant(0.03, "1", "The same along the view, of a body that one camera sees as a point.", "Chosen.")
    jump: float = constant(
        0.5, "1", "Standard deviation of the field's change from frame to frame while following, relative to its expected size.", "Chosen."
    )
    strain: float = constant(
        0.2, "1", "Size of the force's symmetric gradient while following, relative to that of its rotation.", "Chosen."
    )


PRIOR = PriorConstants()
