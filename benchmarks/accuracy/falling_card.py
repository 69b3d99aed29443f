"""Cards that flutter and tumble by published equations, and the recovered force:
benchmarks/accuracy/falling_card.py [CARD ...] [--work DIR]

The equations are (5.1) to (5.3) of Andersen, Pesavento and Wang, Analysis of transitions between fluttering, tumbling and steady descent
of falling cards, J. Fluid Mech. 541 (2005), 91-104, with their coefficients: a thin card in still air with added mass, circulation from
translation and rotation, drag and a torque of friction. Their one parameter is I*, the card's mass over that of a cylinder of air about
it. With I* = 1.1 the card flutters with a period of 16.0 units of time, with I* = 1.4 it turns over and over, once in 12.8. The equations
were taken from a public transcription of the paper, whose printed page was not at hand.

Neither the solver nor the drag law of the engine takes part. The card is handed over as points in 3D; the truth is the force density
that the equations' rigid motion takes at every point, density (acceleration - gravity). Printed per card: the error of the recovered
force in size [%] and direction [degrees]; the same of the field that is the same everywhere and has the true net force in every frame; the
error of the net force alone; and what `--field wind` answers. The true wind is 0; a law without added mass, circulation or a lift from
rotation has to put these down to air that moves. Its mean is over card and frames; it stands beside the card's mean speed.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from wind_truth import SPACING, YOUNGS_MODULUS, engine, errors, print_table

from seeing_wind.engine.reading import read_arrays

AIR, G = 1.2, 9.81
"""Density [kg/m³] and gravity [m/s²]."""
C_T, C_R, A, B, MU_1, MU_2 = 1.2, np.pi, 1.4, 1.0, 0.2, 0.2
"""Circulation of translation and rotation, drag, friction of rotation: as published."""
CARDS = {"fluttering": 1.1, "tumbling": 1.4}
"""Cards by name -> I*."""
COUNTS = (13, 10, 2)
"""Points along the chord, the span and the thickness."""
HALF_CHORD = 0.5 * SPACING * COUNTS[0]
FPS, FRAMES = 30.0, 36
LOOKS = 16
"""Number of times per frame over which the force is averaged."""


def slope(inertia: float, state: np.ndarray) -> np.ndarray:
    """Rate of change of u, v (along the card and across it), spin, angle, x, y (height); lengths in half chords."""
    u, v, spin, angle = state[:4]
    speed = np.hypot(u, v)
    turning = 2.0 / np.pi * (-C_T * u * v / speed + C_R * spin)
    drag = (A - B * (u**2 - v**2) / speed**2) * speed / np.pi
    return np.array([
        ((inertia + 1.0) * spin * v - turning * v - np.sin(angle) - drag * u) / inertia,
        (-inertia * spin * u + turning * u - np.cos(angle) - drag * v) / (inertia + 1.0),
        4.0 * (-u * v - (MU_1 + MU_2 * abs(spin)) * spin) / (inertia + 0.5),
        spin,
        u * np.cos(angle) - v * np.sin(angle),
        u * np.sin(angle) + v * np.cos(angle),
    ])  # fmt: skip


def fallen(inertia: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (T+1, N, 3) [m] of a card at every frame, acceleration without gravity (T, N, 3) [m/s²], turn (T+1,) of the card [rad]."""
    length, velocity = HALF_CHORD, np.sqrt(inertia * G * HALF_CHORD)  # the card's own weight sets the scale; its buoyancy in air is nothing
    unit = length / velocity
    times = np.arange(FRAMES * LOOKS + 1) / (FPS * LOOKS * unit)
    states = solve_ivp(
        lambda t, y: slope(inertia, y), (0.0, times[-1]), [1e-3, 1e-3, 1e-3, 0.25 * np.pi, 0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-11
    ).y.T
    rates = np.array([slope(inertia, state) for state in states])
    u, v, spin, angle = states[:, :4].T
    c, s = np.cos(angle), np.sin(angle)
    du, dv = rates[:, 0] - spin * v, rates[:, 1] + spin * u  # the frame of u and v turns
    acceleration = np.stack([c * du - s * dv, s * du + c * dv], axis=1) * velocity / unit
    axes = [SPACING * (np.arange(count) - 0.5 * (count - 1)) for count in COUNTS]
    chord, span, thick = (grid.ravel() for grid in np.meshgrid(*axes, indexing="ij"))
    arm = np.stack([c[:, None] * chord - s[:, None] * thick, s[:, None] * chord + c[:, None] * thick], axis=2)
    place = length * states[:, None, 4:] + arm
    turn, faster = (spin / unit)[:, None, None], (rates[:, 2] / unit**2)[:, None, None]
    felt = acceleration[:, None] + faster * np.stack([-arm[..., 1], arm[..., 0]], axis=2) - turn**2 * arm
    x = np.stack([place[..., 0], np.broadcast_to(span, place.shape[:2]), place[..., 1]], axis=2)
    push = np.stack([felt[..., 0], np.zeros(place.shape[:2]), felt[..., 1] + G], axis=2)
    mean = 0.5 * (push[1:] + push[:-1]).reshape(FRAMES, LOOKS, -1, 3).mean(axis=1)
    return x[::LOOKS], mean, angle[::LOOKS]


def row(name: str, work: Path) -> str:
    """A line of the table."""
    inertia, take = CARDS[name], work / name
    x, push, angle = fallen(inertia)
    density = inertia * np.pi * AIR * HALF_CHORD / 2.0 / (SPACING * COUNTS[2])
    take.mkdir(parents=True, exist_ok=True)
    np.savez(take / "truth.npz", x=x, fps=FPS, rho=density, E=YOUNGS_MODULUS, nu=0.3, gravity=np.array([0.0, 0.0, -G]))
    np.save(take / "points.npy", x[:-1])
    engine("recover-trajectories", take / "truth.npz", "--take", take / "take", "--field", "force", "--report", "none")
    engine("sample", take / "take", "--points", take / "points.npy", "--out", take / "force.npz")
    found, true = read_arrays(take / "force.npz")["force_density"], density * push
    net = true.mean(axis=1, keepdims=True)
    pairs = [errors(found, true), errors(np.broadcast_to(net, true.shape), true), errors(found.mean(axis=1, keepdims=True), net)]
    told = f"{np.linalg.norm(FPS * np.diff(x, axis=0).mean(axis=1), axis=1).mean():.2f}"
    asked = ["recover-trajectories", take / "truth.npz", "--take", take / "take", "--field", "wind", "--report", "none"]
    try:
        engine(*asked)
    except subprocess.CalledProcessError as error:
        told += f" | refused (exit code {error.returncode})"
    else:
        engine("sample", take / "take", "--points", take / "points.npy", "--out", take / "wind.npz")
        wind = read_arrays(take / "wind.npz")["wind_velocity"]
        told += f" | {np.linalg.norm(wind, axis=-1).mean():.2f}, mean vector {np.linalg.norm(wind.mean(axis=(0, 1))):.2f}"
    turns = f"{np.degrees(np.ptp(angle)):.0f}"
    return " | ".join([f"| {name}, I* = {inertia}", turns, *(f"{size:.1f} / {direction:.1f}" for size, direction in pairs), told]) + " |"


HEAD = "| card | turns [degrees] | force: size % / degrees | uniform | net force | card's speed [m/s] | wind found [m/s] |"

if __name__ == "__main__":
    print_table(__doc__, "CARD", CARDS, HEAD, row)
