"""Small sound inputs of every kind, for the suites to break: made in a second, without a solve."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np

from benchmarks.scenes.gusts import GustField
from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.field.confidence import ConfidenceMap
from seeing_wind.engine.field.representations.triplane import CausalTriPlane, ForceFieldTriPlane
from seeing_wind.engine.materials import find
from seeing_wind.engine.record_arrays import to_arrays
from seeing_wind.engine.records import Attachment, Body, Gaussians, Outcome, Particles, Recovery, Surface
from seeing_wind.engine.take import Take

WIDTH, HEIGHT, FRAMES, FPS = 64, 48, 6, 24.0
BOX = np.array([[-0.1, -0.1, -0.1], [0.2, 0.2, 0.2]])
LATTICE = 0.02 * np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), -1).reshape(-1, 3)
TETRAHEDRON = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def blown(frames: int = 8) -> np.ndarray:
    """Trajectories (T+1, 27, 3) [m] of a block under a constant acceleration."""
    time = np.arange(frames + 1) / FPS
    return LATTICE + (1.5 * time**2)[:, None, None] * np.array([1.0, 0.0, 0.2])


def sow(folder: Path) -> Path:
    """Write one sound input of every kind into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    _clip(folder)
    camera = {"width": WIDTH, "height": HEIGHT, "fx": 70.0, "fy": 70.0, "cx": 31.5, "cy": 23.5}
    (folder / "camera.json").write_text(json.dumps(camera | {"camera_to_world": front_view(2.0).tolist()}))
    np.save(folder / "depth.npy", np.full((HEIGHT, WIDTH), 2.0, np.float32))
    start = np.stack(np.meshgrid(np.arange(14.0, 30.0, 4.0), np.arange(12.0, 28.0, 4.0)), -1).reshape(-1, 2)
    xy = start + np.arange(FRAMES)[:, None, None] * np.array([0.0, 1.0])
    np.savez_compressed(folder / "tracks.npz", xy=xy, visible=np.ones(xy.shape[:2], bool))
    np.savez_compressed(folder / "t.npz", x=blown(), fps=FPS, E=1e5, rho=300.0, nu=0.3, gravity=np.zeros(3))
    np.save(folder / "p.npy", LATTICE)
    np.savez(folder / "mesh.npz", vertices=TETRAHEDRON[0], triangles=TETRAHEDRON[1])
    rows = [f"v {x} {y} {z}" for x, y, z in TETRAHEDRON[0]] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in TETRAHEDRON[1]]
    (folder / "mesh.obj").write_text("\n".join(rows) + "\n")
    np.save(folder / "pins.npy", np.array([0, 1]))
    (folder / "edit.toml").write_text('[[body]]\nname = "thing"\nmesh = "mesh.obj"\nmaterial = "rubber"\npin = "pins.npy"\n')
    mask = str(folder / "mask.png")
    one = {"name": "leaf", "object": "leaf", "material": "leaf", "mask": mask, "law": "neo_hookean"}
    numbers = {"density": 300.0, "youngs_modulus": 1e5, "poisson_ratio": 0.3, "yield_stress": None, "viscosity": None}
    (folder / "objects.json").write_text(json.dumps({"objects": [one | numbers]}))
    _take(Take(folder / "whole.take"))
    return folder


def _clip(folder: Path) -> None:
    """A bright square that drifts over a plain background: a video, its frames as frames, and its mask."""
    writer = cv2.VideoWriter(str(folder / "clip.avi"), cv2.VideoWriter.fourcc(*"MJPG"), FPS, (WIDTH, HEIGHT))
    (folder / "frames").mkdir(exist_ok=True)
    for t in range(FRAMES):
        frame = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
        frame[10 + t : 30 + t, 12:32] = 220
        writer.write(frame)
        cv2.imwrite(str(folder / f"frames/{t:03d}.png"), frame)
    writer.release()
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[10:30, 12:32] = 255
    cv2.imwrite(str(folder / "mask.png"), mask)
    cv2.imwrite(str(folder / "pin.png"), np.where(np.arange(HEIGHT)[:, None] < 12, mask, 0))


def _take(take: Take) -> None:
    """A take with a field, a body and a recovery that fit each other."""
    x, count = blown(4), len(LATTICE)
    own = Attachment(np.arange(count, dtype=np.int32)[:, None], np.ones((count, 1)))
    particles = Particles(LATTICE, np.full(count, 0.02**3), np.zeros(count, bool), 0.02)
    gaussians = Gaussians(
        LATTICE, np.full((count, 3), 0.01), np.tile([1.0, 0, 0, 0], (count, 1)), np.full(count, 0.9), np.zeros((count, 1, 3)), own
    )
    four = Attachment(np.arange(4, dtype=np.int32)[:, None], np.ones((4, 1)))
    surface = Surface(LATTICE[:4], TETRAHEDRON[1].astype(np.int32), np.zeros((4, 2)), four)
    take.write_arrays("particles.npz", to_arrays(Body(particles, find("rubber"), gaussians, surface, own, x)))
    recovery = Recovery(
        Outcome.CONVERGED, np.zeros((4, count, 3)), np.ones((4, count)), x, np.tile(np.eye(3), (5, count, 1, 1)), np.zeros((count, 3)),
        np.zeros(5), "px", 1, 0.1,
    )  # fmt: skip
    take.write_arrays("trajectory.npz", to_arrays(recovery) | {"fps": np.array(FPS)})
    module = CausalTriPlane(4, [(4, 4, 4)], features=4, width=8)
    sure = ConfidenceMap(x[:4], np.ones((4, count)), 0.05)
    ForceFieldTriPlane(BOX, FPS, 4, module, 1.0, sure).save(take.file("field.safetensors"))
    gusts = Take(take.path.with_name("gusts.take"))
    gusts.path.mkdir(exist_ok=True)
    GustField(1, BOX, FPS, 4, np.zeros(3), 2.0, wavelength=1.0, period=0.8).save(gusts.file("field.safetensors"))
