"""Constants of the noise: errors of what was observed, and how far the solver's body strays from the filmed one."""

from __future__ import annotations

from dataclasses import dataclass

from ...conventions import constant

SCENES = "Development scenes, docs/notebook/held_bodies.md."


@dataclass(frozen=True)
class NoiseConstants:
    """The mismatch of 3D points and of a held body; the mismatch of tracks; outliers; and the clamp's own motion."""

    white: float = constant(
        1e-3, "particle spacings", "White part of the mismatch of 3D points.", "The evidence scales it for free bodies."
    )
    slow: float = constant(2e-3, "particle spacings", "Slow part of the mismatch of 3D points.", "The evidence scales it for free bodies.")
    slow_time: float = constant(8.0, "frames", "Correlation time of the slow part.", "Chosen.")
    plastic_factor: float = constant(
        10.0, "1", "Factor on the variance of the mismatch of a body that flows.", "Development scene: clay."
    )
    motion: float = constant(
        0.02, "1", "Mismatch of a held body in each mode, relative to its motion in that mode: the error in bending that remains after "
        "stiffness, section and clamp were fitted. In pixels, the mismatch of tracks covers it.",
        "Another simulator's posts that move by the true force, the three fitted: 0.4 to 0.9 % of the motion in modes of degree 0 and 1, "
        "1 to 2.3 % in degree 2 and 3.",
    )  # fmt: skip
    motion_white: float = constant(0.2, "1", "White part of this mismatch, relative to the whole.", SCENES)
    sag_frames: int = constant(6, "frames", "Frames in which a held body that starts without strain would be seen to sag.", "Chosen.")
    sag_seen: float = constant(
        5.0, "deviations", "The expected sag of all points together must be at least this large for its absence to count.", "Chosen."
    )
    drift: float = constant(
        0.05, "1", "Drift of a held body away from the solver's within `drift_frames`, relative to its motion, as the integral of a random "
        "walk: a clamp gives way under a lasting force. Taken for bending, it would require a force that grows through the clip.",
        "After 4 s of gusts another simulator's posts stood 4 to 8 % of their motion away from where bending put them; this solver's, "
        "0.1 to 3 %.",
    )  # fmt: skip
    drift_frames: float = constant(90.0, "frames", "Time to which `drift` refers.", "Arbitrary.")
    along: float = constant(
        0.1, "1", "`motion` along the body's own curve, relative to the motion along it. Bending does not show there, so the motion along "
        "it is small, and it shows the force along the body, which bending does not.", SCENES,
    )  # fmt: skip
    drift_whole: float = constant(
        0.015, "1", "`drift` of mode 0 along the curve, relative to the motion of the whole body: a clamp gives way.",
        "Another simulator's posts that move by the true force: 0 to 0.024 in 4 s.",
    )  # fmt: skip
    drift_turned: float = constant(
        0.008, "1", "`drift` of the sections' rotation against the curve, also relative to the motion of the whole body: a clamp tilts, "
        "and the sections with it.", "The same posts: 0.001 to 0.012.",
    )  # fmt: skip
    along_whole: float = constant(
        0.002, "1", "`along` of mode 0, relative to the motion of the whole body.",
        "The same posts, without the drift and the part in phase with the swing: 0.0012 to 0.0028.",
    )  # fmt: skip
    stretch: float = constant(
        0.0045, "1", "Mismatch, in addition to `along`, of the stretch along the curve (modes that vary along the body only, without mode "
        "0), relative to the squared motion of the whole body over its length: bending shortens a body by about that, and has an error.",
        "Another simulator's posts that move by the true force: from frame to frame 0.002 to 0.009, 0.004 in the median, which is 1 to 6 "
        "um for swings of 7 to 26 mm. With 0.008, the recovery of a branch in the tests that is let go is worse.",
    )  # fmt: skip
    stretch_least: float = constant(
        2e-4, "particle spacings", "The same for a body that does not move.", "With half of it, the error for a post in the tests whose "
        "clamp sways is twice as large.",
    )  # fmt: skip
    drift_stretch: float = constant(0.001, "1", "`drift` of the stretch.", "As `stretch`: 0.0004 to 0.0024.")
    swift_stretch: float = constant(
        0.25, "1", "Share of the stretch's `swift` part that is taken for mismatch.",
        "For the same posts the share is 0.13 and 0.23 where a sudden wind makes them ring lengthwise.",
    )  # fmt: skip
    turned: float = constant(
        0.001, "1", "`stretch` of the other modes: rotation of the sections relative to the curve.",
        "The same posts turn by 0.003 to 0.007, in phase with their swing; with 0.003, recoveries of those that swing far are worse.",
    )  # fmt: skip
    lengthwise: float = constant(
        0.1, "1", "A mode counts as varying along the body only if less than this share of it varies across the body.", "Chosen."
    )
    leak: float = constant(
        0.01, "1", "Motion of a held body as a whole along its axis in phase with its motion across it: a clamp turns about a place beside "
        "the axis.", "Another simulator's post: 1 %. Its stretch in phase with its swing, 0.01 to 0.2 %, is not allowed for, as that would "
        "hide the force along the body.",
    )  # fmt: skip
    swift: int = constant(
        7, "frames", "Frames over which a cubic is fitted to a held body's motion in each mode. Faster swings, as after a strike, stay in "
        "phase with the solver's body for a few periods only and are too fast for the force's knots, so they are all taken for mismatch.",
        SCENES,
    )  # fmt: skip
    absorbed_factor: float = constant(
        4.0, "1", "Mismatch relative to the part of it left in the residuals: the force has fitted the rest.", "Chosen."
    )

    track_white: float = constant(
        0.02, "px", "White part of the mismatch of tracks. It is an error of the whole body's motion, which more tracks show better but do "
        "not average out: its variance per track is multiplied by their number.", "Between two scenes, as `track_slow`.",
    )  # fmt: skip
    track_slow: float = constant(
        0.33, "px", "Slow part of the mismatch of tracks.", "Between two scenes: a third of it is best for a plate from another solver, "
        "three times as much for a plate whose layers and stiffness are guessed.",
    )  # fmt: skip
    track_slow_time: float = constant(24.0, "frames", "Correlation time of the slow part.", "Chosen.")
    flowing_white: float = constant(
        0.021, "px", "`track_white` for bodies that flow: as flow differs between solvers, 0.3 px with 200 tracks.",
        "Development scene: clay.",
    )  # fmt: skip
    flowing_slow: float = constant(
        0.043, "px", "`track_slow` for bodies that flow: small, or a lasting error of the force could hide in it, as nothing springs back.",
        "Development scene: clay.",
    )  # fmt: skip
    track_misfit: float = constant(
        0.5, "deviations", "Misfit of a solution above which the tracks' mismatch is raised, as for soft sheets that swing far.",
        "Seen: 0.1 to 0.2 for another simulator's sheet and post, 0.3 for its banner.",
    )  # fmt: skip
    late_offset: float = constant(0.5, "px", "Standard deviation of the attachment of a track that was not there in frame 0.", "Chosen.")
    huber: float = constant(
        2.0, "deviations", "Residuals of tracks beyond this pull with constant force (Huber).", "Usual: 1.3 to 3."
    )
    end_wild: float = constant(
        4.0, "1", "The first or last frames of a clip are wild, and count little, when their tracks miss by this many times as much as in "
        "the median frame. Tracks that slide with an outline that leaves the view, or with blur, look like this; so does a force that "
        "begins suddenly at the clip's end, where no later frames can distinguish the two.",
        "Small made-up bodies whose last tracks were displaced.",
    )  # fmt: skip
    end_least: float = constant(3.0, "deviations", "Such an end must also miss by this much in the median of the tracks,", "Chosen.")
    end_odd: float = constant(
        1.5, "1", "and all its frames must miss by this many times as much as the median frame.", "As `end_wild`."
    )
    end_part: float = constant(0.25, "1", "Largest share of the clip's frames that such an end may have.", "Chosen.")
    end_fewest: int = constant(8, "frames", "Fewest frames from which the usual miss is determined.", "Chosen.")
    end_usual: float = constant(
        0.25, "deviations", "Lower bound of the usual miss of tracks: where their sigma is too large, they miss by less.", "Chosen."
    )
    edge_on: float = constant(
        0.25, "1", "A track is dropped while its neighbourhood's image is squeezed to less than this share of frame 0.", "Chosen."
    )
    neighbours: int = constant(10, "tracks", "Number of tracks in the neighbourhood.", "Chosen.")

    wild: float = constant(8.0, "medians", "A 3D point is wild if it misses the others' smooth motion by more than this,", "Chosen.")
    wild_spacings: float = constant(0.2, "particle spacings", "and also by more than this.", "Chosen.")
    least_weight: float = constant(0.02, "1", "Smallest weight of a point, relative to the most certain point.", "Chosen.")
    same_noise: float = constant(
        1.2, "1", "Bounds on the noise that differ by less than this factor are equal within their own uncertainty.", "Chosen."
    )
    point_modes: int = constant(20, "modes", "Most displacement modes to which 3D points are reduced.", "docs/notebook/sensitivity.md.")
    slice: float = constant(1.5, "particle spacings", "Least thickness of a slice across a bent body.", "Chosen.")
    fewest_slices: int = constant(4, "slices", "Fewest slices that show a curve.", "Geometry.")
    most_slices: int = constant(24, "slices", "Most slices of a body.", "Chosen.")
    curve_degree: int = constant(
        5, "degree", "Degree of the polynomials along a body that smooth the curve of its slices' centres.",
        "A post clamped at its foot, bent in its first two modes; with 7, the recovery of posts is the same.",
    )  # fmt: skip

    told: float = constant(
        0.5, "1", "A mode is used in a frame if, of a mode of unit size, the points seen there show at least this share that the modes "
        "before it do not explain.", "Chosen.",
    )  # fmt: skip
    clamp_rides: float = constant(
        0.99, "1", "A point shows the clamp if more than this share of its weight is on pinned particles.", "Geometry."
    )
    clamp_frames: int = constant(8, "frames", "Fewest frames in which the noise of the clamp's motion can be measured.", "Statistics.")
    clamp_clear: float = constant(
        3.0, "deviations", "The clamp is taken to move if its root mean square motion exceeds the noise of one frame by this.", "Usual."
    )
    clamp_rigid: float = constant(
        0.5, "1", "Largest motion of the pinned points relative to each other, beyond their noise, as a share of their common motion.",
        "Chosen.",
    )  # fmt: skip


NOISE = NoiseConstants()
