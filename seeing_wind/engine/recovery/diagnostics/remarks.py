"""Notes on what a clip does not show, and on what it contradicts."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...conventions import DISTRUST, DRAFT, UNHELD, frame_named, frames_named, in_figures, in_units
from ...records import Particles
from ..prior.basis import runs_of
from ..targets.clamp_motion import ClampMotion
from ..targets.objective import Channels
from ..targets.points import PointChannels
from ..targets.tracks import TrackChannels

EXPLAINS_NOTHING = "no force explains this motion"
"""Part of the note of `missed.astray`."""
ROUGHLY = "the force follows that motion only roughly"
"""Part of the note of `missed.roughly`."""
ALONG_VIEW = "Force along the view is low confidence from one camera: a second view, a known length or a held part would settle it."
SUDDEN, SUDDEN_WAY = 6.0, 1e-4
"""There is a note if the largest residual exceeds both the first number times the median and the second times the largest displacement."""
STILL = 0.02
"""A body hardly moves if its largest displacement is less than this share of its radius [m/m]."""
COASTING = 0.01
"""A force hardly acts on a body if, in the time of the clip, it moves it by less than this share of its largest displacement."""
REACTION = 0.1
"""A mean force holds the body up if it differs from the opposite of the weight by less than this share of the weight."""
HELD = 0.9
"""A track is on a held part if the pinned particles have more than this share of its attachment's weight."""
TURNS = 0.1
"""Rotation of a clamp [degrees] from which it is mentioned."""
LOOSE = 3.0
"""Median distance [px] of the tracks on held parts from their places, from which there is a note."""


def worst_first(notes: Sequence[str]) -> list[str]:
    """A recovery's notes, sorted: first those that call its field useless, then that it is rough, that nothing was held, and the others as
    they were."""

    def rank(note: str) -> int:
        if DISTRUST in note or EXPLAINS_NOTHING in note:
            return 0
        return 1 if ROUGHLY in note else 2 if UNHELD in note else 3

    return sorted(notes, key=rank)


def radius_of(x: np.ndarray) -> float:
    """Largest distance of one of the points x (N, 3) from their mean."""
    return float(np.linalg.norm(x - x.mean(axis=0), axis=1).max())


def motion_remarks(particles: Particles, x: np.ndarray, residual: np.ndarray, views: int, errors: float = 0.0) -> list[str]:
    """Notes on a simulation x (T+1, N, 3) [m] and its `residual` (T+1,), in [px] for tracks and in [m] for points in 3D.

    Args:
        views: number of views; 0 for points in 3D.
        errors: stated errors of points in 3D, root mean square distance [m]; a residual of this size is explained by them.
    """
    notes = []
    moved = np.linalg.norm(x - x[0], axis=-1).max()
    shown = residual[1:][residual[1:] > 0.0]  # nothing was seen in the others
    far, peak = float(np.median(shown)) if len(shown) else 0.0, int(residual.argmax())
    small, off = STILL * max(radius_of(particles.x), particles.spacing), math.sqrt(max(far**2 - errors**2, 0.0))
    if moved < small and (views or off < small):
        notes.append(f"The body hardly moves ({in_units(moved, 'm', 2)}): the force is known only as the one that holds it still.")
    if not views and residual[peak] > max(SUDDEN * far, SUDDEN_WAY * moved):
        notes.append(
            f"In {frame_named(peak)} the simulated body is {in_units(residual[peak], 'm', 2)} off, otherwise {in_units(far, 'm', 2)}: "
            "where the force changes suddenly, it is smoothed over about four frames."
        )
    if views == 1:
        notes.append(ALONG_VIEW)
    return notes


DRAFTED = (
    f"{DRAFT}, from one iteration: its force is rough, and so is every verdict on it. Recover without --iterations 1 for the final one."
)
BORNE = (
    "The object is taken to bear its weight as it stands in frame 0, so the force found is what moves it from there. Where it did begin "
    "without a load, its points would be seen to sag."
)


def force_remarks(acceleration: np.ndarray, density: float, x: np.ndarray, fps: float, gravity: Sequence[float]) -> list[str]:
    """Note on an acceleration (T, N, 3) [m/s²], in addition to gravity, that hardly matters to the motion x (T+1, N, 3) [m]."""
    size, way = float(np.sqrt((acceleration**2).sum(axis=-1).mean())), float(np.linalg.norm(x - x[0], axis=-1).max())
    duration = len(acceleration) / fps
    if not 0.5 * size * duration**2 < COASTING * way:
        return []
    alone = "only the given gravity" if np.any(gravity) else "no force"
    found = f"the force found, {in_figures(density * size, 2)} N/m³, is too small to be known well"
    return [f"The body moves as if {alone} acted on it: {found}."]


def reaction_remarks(particles: Particles, acceleration: np.ndarray, x: np.ndarray, gravity: Sequence[float]) -> list[str]:
    """Note on a body that stays in place although nothing is marked as held, and whose mean `acceleration` (T, N, 3) [m/s²] undoes gravity.

    The motion does not show whether a support or an upward wind holds it. A gliding body is also carried, by air, but there is no note on
    it: it moves, along x (T+1, N, 3) [m], by more than its own radius.
    """
    down = np.asarray(gravity, dtype=np.float64)
    centre = x.mean(axis=1)
    leaves = float(np.linalg.norm(centre - centre[0], axis=1).max()) > max(radius_of(particles.x), particles.spacing)
    carried = np.linalg.norm(acceleration.mean(axis=(0, 1)) + down) < REACTION * np.linalg.norm(down)
    if particles.pinned.any() or leaves or not carried:
        return []
    return [
        f"{UNHELD}; the force found is as large as the body's weight, so it may be only what holds the body up, not a wind. If something "
        "holds it, mark that, or recover without gravity."
    ]


def unseen_remarks(used: np.ndarray, shown: np.ndarray) -> list[str]:
    """Notes on frames in which nothing, or only a held part, was seen; frame 0 is where the body begins.

    Args:
        used: (T+1, channels) bool, the channels that are used in each frame.
        shown: (T+1,) bool, see `Objective.shown`.
    """
    notes = []
    for first, end in runs_of(~shown[1:]):
        seen = "Only what is held" if used[first + 1 : end + 1].any() else "Nothing"
        notes.append(
            f"{seen} of the object is seen {frames_named(first + 1, end)}: the force there is a guess from the other frames, and the "
            "simulation was compared with nothing that moves."
        )
    return notes


def wild_remarks(channels: Sequence[Channels]) -> list[str]:
    """Notes on points that were left out because they do not move with those around them."""
    astray = [one.wild for one in channels if isinstance(one, PointChannels) and one.wild.any()]
    return [
        f"{np.count_nonzero(wild.any(axis=0))} of {wild.shape[1]} points leave the motion of those round them in some frames "
        f"({np.count_nonzero(wild.any(axis=1))} of {len(wild)}) and are left out there."
        for wild in astray
    ]


def ringing_remarks(still: np.ndarray) -> list[str]:
    """Notes on the frames, `still` (T,) bool, in which the body was found to swing freely."""
    return [
        f"From {frame_named(first)} to {frame_named(end - 1)} the object swings by itself, as nothing pushes it: no force was looked for "
        "there. --ringing ignored looks for one."
        for first, end in runs_of(still)
    ]


def end_remarks(wild: np.ndarray) -> list[str]:
    """Notes on intervals at the ends of a clip, `wild` (T,) bool, whose later frame has little weight: its tracks do not fit all others."""
    notes = []
    for which, run in (("first", _leading(wild)), ("last", _leading(wild[::-1]))):
        first, last = (0, run - 1) if which == "first" else (len(wild) - run, len(wild) - 1)
        if run:
            frames = frames_named(first, last)
            notes.append(
                f"The tracks of the {which} frames leave the motion of all others and count little: the force {frames} is not seen, but "
                "goes on from the others. If the object is blurred there or leaves the frame, choose --frames without them."
            )
    return notes


def _leading(flags: np.ndarray) -> int:
    """How many of `flags` (T,) bool are true before the first that is not."""
    return int(np.argmin(np.append(flags, False)))


def moving_clamp_remark(motion: ClampMotion) -> str:
    """Note on a clamp that was seen to move."""
    turn = f" and turns by up to {motion.widest:.2g} degrees" if motion.widest >= TURNS else ""
    return f"What is held moves by up to {in_units(motion.largest, 'm', 2)}{turn}: that was taken for its own motion, not for a force."


def wider_remarks(particles: Particles) -> list[str]:
    """Note on a body whose thin parts are simulated thicker and softer than they are (`observe.object.shape.on_stem`)."""
    # The stem's particles come first, and a head of its own material is no thinner than it looks.
    softest = 1.0 if particles.stiffness is None else float(particles.stiffness[0])
    if softest >= 1.0:
        return []
    share = f"1/{1.0 / softest:.0f}"
    return [
        f"Its thin parts are simulated {softest**-0.5:.1f} times as thick, with {share} of Young's modulus: so they bend as stiffly, "
        f"weigh as much, and need {share} of the substeps. Stretched they are softer than the real ones, and what touches "
        "them is touched sooner."
    ]


def held_remarks(particles: Particles, channels: Sequence[Channels]) -> list[str]:
    """Note on tracks that move although they are on parts marked as held."""
    farthest = 0.0
    for one in channels:
        if not isinstance(one, TrackChannels):
            continue
        on = one.points @ particles.pinned.astype(float) > HELD
        rest = one.points[on] @ particles.x
        for t, (xy, visible) in enumerate(zip(one.targets.xy, one.targets.visible, strict=True)):
            seen = visible[on]
            if seen.any():
                off = np.linalg.norm(one.camera.project(rest[seen], t)[0] - xy[on][seen], axis=1)
                farthest = max(farthest, float(np.median(off)))
    if farthest < LOOSE:
        return []
    return [
        f"What is held moves by {in_figures(farthest, 2)} pixels in the clip, but the force was found as if it stood still. Check "
        "--pin, and that the camera stands still or its motion is given."
    ]
