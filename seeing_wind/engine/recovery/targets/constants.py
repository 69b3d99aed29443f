"""Constants of the noise: errors of what was observed, and how far the solver's body strays from the filmed one."""

from __future__ import annotations

from dataclasses import dataclass

from ...conventions import constant

SCENES = "Development scenes, docs/notebook/held_bodies.md."


@dataclass(frozen=True)
class NoiseConstants:
    """The mismatch of 3D points and of a held body, that of tracks, outliers, and the clamp's own motion."""

    white: float = constant(
        1e-3, "particle spacings", "White part of the mismatch of 3D points.", "The evidence scales it for free bodies."
    )
    slow: float = constant(2e-3, "particle spacings", "Its slow part.", "The evidence scales it for free bodies.")
    slow_time: float = constant(8.0, "frames", "How long the slow part lasts.", "Chosen.")
    plastic_factor: float = constant(10.0, "1", "On the variance of the mismatch of a body that flows.", "Development scene: clay.")
    motion: float = constant(
        0.02, "1", "On a held body: the mismatch in each mode in its own motion. It is what stiffness, section and clamp leave of how the "
        "body bends. In pixels, the mismatch of tracks covers it.",
        "Another simulator's posts that move by the true force, the three fitted: 0.4 to 0.9 % of the motion in modes of degree 0 and 1, "
        "1 to 2.3 % in degree 2 and 3.",
    )  # fmt: skip
    motion_white: float = constant(0.2, "1", "How much of that is white.", SCENES)
    sag_frames: int = constant(6, "frames", "In which a held body that began without a load would be seen to sag.", "Chosen.")
    sag_seen: float = constant(
        5.0, "deviations", "What is seen of that, all points together, has to be as much before it can be missed.", "Chosen."
    )
    drift: float = constant(
        0.05, "1", "How far a held body strays from the solver's in `drift_frames`, in its own motion, as the integral of a random walk: "
        "a clamp gives way under a lasting force. Taken for bending, it would ask for a force that grows through the clip.",
        "After 4 s of gusts another simulator's posts stood 4 to 8 % of their motion away from where bending put them; this solver's, "
        "0.1 to 3 %.",
    )  # fmt: skip
    drift_frames: float = constant(90.0, "frames", "See `drift`.", "A unit for it.")
    along: float = constant(
        0.1, "1", "`motion` along the body's own curve, in the motion along it. Nothing of the bending is seen there, so what moves along "
        "it is small, and tells the force along the body, which bending does not.", SCENES,
    )  # fmt: skip
    drift_whole: float = constant(
        0.015, "1", "`drift` along the curve of mode 0, in the motion of the whole body: a clamp gives way.",
        "Another simulator's posts that move by the true force: 0 to 0.024 in 4 s.",
    )  # fmt: skip
    drift_turned: float = constant(
        0.008, "1", "`drift` of how the sections turn against the curve, in the same: a clamp tilts, and the sections with it.",
        "The same posts: 0.001 to 0.012.",
    )  # fmt: skip
    along_whole: float = constant(
        0.002, "1", "`along` of mode 0, in the same.", "The same posts, without what drifts and what is in step: 0.0012 to 0.0028.",
    )  # fmt: skip
    stretch: float = constant(
        0.0045, "1", "Mismatch beside `along` of the stretch along the curve, of modes that vary along the body only but for mode 0, in "
        "the square of the motion of the whole body over its length: by as much a bent body is shorter, and its bending is off.",
        "Another simulator's posts that move by the true force: from frame to frame 0.002 to 0.009, 0.004 in the median, which is 1 to 6 "
        "um of swings of 7 to 26 mm. With 0.008 a branch of the tests that is let go comes back worse.",
    )  # fmt: skip
    stretch_least: float = constant(
        2e-4, "particle spacings", "The same of a body that does not move.", "With half of it a post of the tests whose clamp sways comes "
        "back with twice the error.",
    )  # fmt: skip
    drift_stretch: float = constant(0.001, "1", "`drift` of the stretch.", "As `stretch`: 0.0004 to 0.0024.")
    swift_stretch: float = constant(
        0.25, "1", "How much of the stretch that is `swift` is taken for mismatch.",
        "The same posts: 0.13 and 0.23 of it is, where a wind that begins at once makes them ring along themselves.",
    )  # fmt: skip
    turned: float = constant(
        0.001, "1", "`stretch` of the other modes: how the sections turn against the curve.",
        "The same posts turn by 0.003 to 0.007, in step with their swing; with 0.003 those that swing far come back worse.",
    )  # fmt: skip
    lengthwise: float = constant(0.1, "1", "Share of a mode that may vary across a body of which it is said that it does not.", "Chosen.")
    leak: float = constant(
        0.01, "1", "How far a held body as a whole moves along its axis in step with what it does across it: a clamp turns about a place "
        "beside the axis.", "Another simulator's post: 1 %. Its stretch in step with its swing, 0.01 to 0.2 %, is left out: allowed for, "
        "it hides the force along the body.",
    )  # fmt: skip
    swift: int = constant(
        7, "frames", "Over which a cubic is fitted to a held body's motion in each mode. What swings faster, as after a strike, is in step "
        "with the solver's body for a few periods only and beyond the force's knots, so all of it is taken for mismatch.", SCENES,
    )  # fmt: skip
    absorbed_factor: float = constant(
        4.0, "1", "Mismatch over the part of it left in the residuals: the rest has been fitted by the force.", "Chosen."
    )

    track_white: float = constant(
        0.02, "px", "White part of the mismatch of tracks. It is an error of the whole body's motion, which more tracks see better but do "
        "not average out: its variance per track grows with their number.", "Between two scenes, as `track_slow`.",
    )  # fmt: skip
    track_slow: float = constant(
        0.33, "px", "Its slow part.", "Between two scenes: a plate from another solver does best with a third of it, a plate whose layers "
        "and stiffness are guessed with three times as much.",
    )  # fmt: skip
    track_slow_time: float = constant(24.0, "frames", "How long the slow part lasts.", "Chosen.")
    flowing_white: float = constant(
        0.021, "px", "The same for bodies that flow: as loose in each frame, as flow differs between solvers, 0.3 px with 200 tracks.",
        "Development scene: clay.",
    )  # fmt: skip
    flowing_slow: float = constant(
        0.043, "px", "But not in the long run, or a force that is wrong for good could hide in it, as nothing springs back.",
        "Development scene: clay.",
    )  # fmt: skip
    track_misfit: float = constant(
        0.5, "deviations", "Misfit of a solution above which the tracks' mismatch is raised, as for soft sheets that swing far.",
        "Seen: 0.1 to 0.2 for another simulator's sheet and post, 0.3 for its banner.",
    )  # fmt: skip
    late_offset: float = constant(0.5, "px", "Standard deviation of the attachment of a track that was not there in frame 0.", "Chosen.")
    huber: float = constant(2.0, "deviations", "Residuals of tracks beyond it pull with constant force.", "Usual: 1.3 to 3.")
    end_wild: float = constant(
        4.0, "1", "The first or last frames of a clip are wild, and count little, when their tracks miss by so many times as much as in "
        "the middle frame. So look tracks that slide with an outline that leaves the view, or with blur; a force that begins there of a "
        "sudden looks the same, and nothing after it tells them apart.", "Small made-up bodies whose last tracks were displaced.",
    )  # fmt: skip
    end_least: float = constant(3.0, "deviations", "And by so much, in the median of the tracks.", "Chosen.")
    end_odd: float = constant(1.5, "1", "And, in all frames up to the clip's end, by so many times as much.", "As `end_wild`.")
    end_part: float = constant(0.25, "1", "Part of the frames that such an end may be.", "Chosen.")
    end_fewest: int = constant(8, "frames", "From which it is told what is usual.", "Chosen.")
    end_usual: float = constant(
        0.25, "deviations", "By which tracks usually miss, at least: by less, where their sigma is too large.", "Chosen."
    )
    edge_on: float = constant(
        0.25, "1", "A track is dropped while its neighbourhood's image is squeezed to less than this share of frame 0.", "Chosen."
    )
    neighbours: int = constant(10, "tracks", "That make the neighbourhood.", "Chosen.")

    wild: float = constant(8.0, "medians", "Miss of the others' smooth motion from which a 3D point is wild,", "Chosen.")
    wild_spacings: float = constant(0.2, "particle spacings", "if it is more than this, too.", "Chosen.")
    least_weight: float = constant(0.02, "1", "Weight of the least certain point, relative to the most certain, at least.", "Chosen.")
    same_noise: float = constant(
        1.2, "1", "Bounds on the noise that differ by less than this factor are the same within their own uncertainty.", "Chosen."
    )
    point_modes: int = constant(20, "modes", "Displacement modes that 3D points are reduced to, at most.", "docs/notebook/sensitivity.md.")
    slice: float = constant(1.5, "particle spacings", "Least thickness of a slice across a bent body.", "Chosen.")
    fewest_slices: int = constant(4, "slices", "Fewer show no curve.", "Geometry.")
    most_slices: int = constant(24, "slices", "At most.", "Chosen.")
    curve_degree: int = constant(
        5, "degree", "Of the polynomials along a body that smooth the curve of its slices' centres.",
        "A post clamped at its foot, bent in its first two modes; with 7, posts come back the same.",
    )  # fmt: skip

    told: float = constant(
        0.5, "1", "A mode counts in a frame when the points seen there show at least this share of it that the modes before it do not "
        "explain.", "Chosen.",
    )  # fmt: skip
    clamp_rides: float = constant(0.99, "1", "A point shows the clamp when so much of its weight is on held particles.", "Geometry.")
    clamp_frames: int = constant(8, "frames", "With fewer, the noise of the clamp's motion cannot be measured.", "Statistics.")
    clamp_clear: float = constant(
        3.0, "deviations", "Motion of the clamp (root mean square, over the noise of one frame) from which it is believed.", "Usual."
    )
    clamp_rigid: float = constant(
        0.5, "1", "Most that the held points may move against each other, beyond their noise, of how far they move together.", "Chosen."
    )


NOISE = NoiseConstants()
