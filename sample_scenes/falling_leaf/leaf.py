"""The leaf: an outline with teeth and a stalk, a triangle mesh of it, and its frame, all from a seed with NumPy alone.

Leaf coordinates: u across, v from the stalk's end towards the tip [m], the blade's middle at the origin; the mesh lies flat in that
plane. One square frame covers `TEXTURE` metres, so a texture coordinate is (u, v) / TEXTURE + 1/2 (origin bottom left, as in Blender).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from outlines import flat_mesh
from painting import mix
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

LENGTH = 0.29
"""From the blade's base to its tip [m]."""
HALF_WIDTH = 0.102
"""At the broadest place [m]."""
STALK = 0.055
"""Length of the stalk [m]."""
STALK_HALF_WIDTH = 0.0042
TEXTURE = 0.40
"""Side of the square that the texture covers [m]."""
VEINS = 9
"""Side veins on either side of the midrib."""


@dataclass(frozen=True)
class Leaf:
    """A flat leaf. vertices (V, 2) u v [m], triangles (M, 3), uv (V, 2) in 0..1, outline (P, 2) closed polygon [m]."""

    vertices: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray
    outline: np.ndarray


def make_leaf(seed: int, edge: float = 0.006) -> Leaf:
    """The leaf of `seed`, triangles with edges of about `edge` metres."""
    outline = _outline(np.random.default_rng(seed))
    vertices, triangles = flat_mesh([outline], edge)
    return Leaf(vertices, triangles, vertices / TEXTURE + 0.5, outline)


def make_texture(seed: int, size: int = 1024) -> np.ndarray:
    """The leaf's colours (size, size, 3) uint8 sRGB, row 0 at the top: autumn colours, veins, cells between them, a few dark spots."""
    rng = np.random.default_rng(seed + 1)
    axis = (np.arange(size) + 0.5) / size * TEXTURE - TEXTURE / 2
    u, v = np.meshgrid(axis, axis[::-1])
    along = np.clip((v + LENGTH / 2) / LENGTH, 0.0, 1.0)
    across = np.abs(u - _bend(along))
    half = _half_width(along) + 1e-4
    edge = np.clip(across / half, 0.0, 1.3)

    # Ground colour: yellow at the veins, through orange, to crimson at the rim, with patches that stayed green.
    blotch = _noise(rng, size, 26) * 0.9 + _noise(rng, size, 9) * 0.55
    redness = np.clip(0.15 + 0.85 * edge**1.3 + 0.55 * blotch + 0.25 * (along - 0.45), 0.0, 1.0)
    stops = np.array([0.0, 0.3, 0.6, 0.85, 1.0])
    colours = np.array([[0.93, 0.75, 0.16], [0.95, 0.56, 0.08], [0.86, 0.27, 0.05], [0.62, 0.08, 0.05], [0.36, 0.04, 0.05]])
    texture = np.stack([np.interp(redness, stops, colours[:, c]) for c in range(3)], -1)
    green = np.clip(2.6 * (_noise(rng, size, 34) - 0.25), 0.0, 0.85) * (1.0 - 0.6 * edge)
    texture = mix(texture, [0.36, 0.46, 0.09], green)
    texture *= 1.0 + 0.16 * _noise(rng, size, 3)[..., None]

    cells, borders = _cells(rng, u, v, 0.0085)
    texture *= (1.0 + 0.20 * cells)[..., None]
    texture = mix(texture, [0.95, 0.66, 0.24], 0.45 * borders)
    texture = mix(texture, [0.28, 0.03, 0.03], 0.55 * _vein_shadow(u, v))
    texture = mix(texture, [0.99, 0.88, 0.47], 0.95 * _veins(u, v))
    texture = _spots(rng, texture, u, v)
    stalk = np.clip((-LENGTH / 2 + 0.004 - v) / 0.006, 0.0, 1.0)
    texture = mix(texture, [0.52, 0.25, 0.10], 0.9 * stalk)
    return (np.clip(texture, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)


# -- shape ------------------------------------------------------------------------------------------------------------------------


def _half_width(along: np.ndarray) -> np.ndarray:
    """Half the blade's width [m] at a place 0..1 between base and tip: broad below the middle, drawn out to a point."""
    along = np.clip(along, 0.0, 1.0)
    profile = np.sqrt(np.clip(np.sin(np.pi * along**0.72), 0.0, None)) * (1.0 - 0.45 * along**2) * (1.0 - along**7)
    return HALF_WIDTH * profile / 0.905


def _bend(along: np.ndarray) -> np.ndarray:
    """How far the midrib runs off the straight line [m]."""
    return 0.010 * np.sin(np.pi * along) * (along - 0.2) * 2.0


def _outline(rng: np.random.Generator) -> np.ndarray:
    """Closed polygon (P, 2): the right side from the base to the tip with teeth that point to the tip, the left side back, the stalk."""
    sides = []
    for sign in (1.0, -1.0):
        along = np.linspace(0.0, 1.0, 900)
        big = (along * VEINS * 1.6 + rng.uniform()) % 1.0
        small = (along * VEINS * 4.8 + rng.uniform()) % 1.0
        tooth = 1.0 + 0.085 * (big - 0.75) + 0.05 * (small - 0.75)
        tooth = 1.0 + (tooth - 1.0) * np.clip(np.minimum(along, 1.0 - along) / 0.08, 0.0, 1.0)
        wave = 1.0 + 0.03 * np.sin(2.0 * np.pi * (1.5 * along + rng.uniform()))
        sides.append(np.stack([_bend(along) + sign * np.maximum(_half_width(along) * tooth * wave, 0.0008), (along - 0.5) * LENGTH], 1))
    right, left = sides
    low = -LENGTH / 2
    drift = rng.uniform(-0.4, 0.4) * STALK * 0.3
    half = STALK_HALF_WIDTH
    stalk = np.array([[-half, low + 0.004], [drift - half, low - STALK], [drift + half, low - STALK], [half, low + 0.004]])
    right, left = (side[np.abs(side[:, 0]) > STALK_HALF_WIDTH * (side[:, 1] < low + 0.02)] for side in sides)
    return np.concatenate([right, left[::-1], stalk])


# -- frame ----------------------------------------------------------------------------------------------------------------------


def _noise(rng: np.random.Generator, size: int, cell: float) -> np.ndarray:
    """Smooth noise of unit deviation with features about `cell` pixels of a 1024 frame wide."""
    count = max(int(1024 / cell), 3)
    lattice = rng.standard_normal((count + 3, count + 3))
    at = (np.arange(size) + 0.5) / size * count + 1.0
    smooth = map_coordinates(lattice, np.meshgrid(at, at, indexing="ij"), order=3, mode="nearest")
    return smooth / smooth.std()


def _vein_distance(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance to the nearest side vein [m] and to the midrib [m]. Side veins leave at 50 degrees and bend towards the tip."""
    along = (v + LENGTH / 2) / LENGTH
    across = u - _bend(np.clip(along, 0.0, 1.0))
    side = np.abs(across)
    level = (v + LENGTH / 2 - 0.62 * side - 2.6 * side**2) / LENGTH * VEINS + 0.35 * (across > 0)
    nearest = np.abs(level - np.round(level)) * LENGTH / VEINS / np.sqrt(1.0 + (0.62 + 5.2 * side) ** 2)
    nearest = np.where((np.round(level) < 0.2) | (np.round(level) > VEINS - 0.5), 1.0, nearest)
    return nearest, np.where(along < 0.99, side, 1.0)


def _veins(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """0..1, the bright veins: the midrib tapers from 4 to 1 mm, side veins from 2.2 to 0.8 mm."""
    nearest, midrib = _vein_distance(u, v)
    along = np.clip((v + LENGTH / 2) / LENGTH, 0.0, 1.0)
    thick = 0.0021 - 0.0016 * along
    fine = 0.0012 - 0.0007 * np.clip(np.abs(u) / HALF_WIDTH, 0.0, 1.0)
    return np.maximum(np.exp(-((midrib / thick) ** 4)), 0.9 * np.exp(-((nearest / fine) ** 4)))


def _vein_shadow(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """0..1, darker tissue that follows the veins at 3 to 4 mm."""
    nearest, midrib = _vein_distance(u, v)
    return np.exp(-(((np.minimum(nearest, midrib) - 0.0036) / 0.0016) ** 2))


def _cells(rng: np.random.Generator, u: np.ndarray, v: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """A shade per cell of the leaf's fine network (-1..1) and the network's lines (0..1)."""
    count = int(TEXTURE / spacing)
    seeds = np.stack(np.meshgrid(np.arange(count), np.arange(count)), -1).reshape(-1, 2) + rng.uniform(-0.45, 0.45, (count * count, 2))
    seeds = (seeds + 0.5) * spacing - TEXTURE / 2
    distance, index = cKDTree(seeds).query(np.stack([u, v], -1).reshape(-1, 2), k=2)
    shade = rng.uniform(-1.0, 1.0, len(seeds))[index[:, 0]]
    line = np.exp(-(((distance[:, 1] - distance[:, 0]) / 0.0011) ** 2))
    return shade.reshape(u.shape), line.reshape(u.shape)


def _spots(rng: np.random.Generator, texture: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Dark brown spots with pale rims, as fungi leave them."""
    for _ in range(34):
        along = rng.uniform(0.06, 0.94)
        centre = np.array([_bend(along) + rng.uniform(-0.9, 0.9) * _half_width(along), (along - 0.5) * LENGTH])
        radius = rng.uniform(0.0022, 0.0062)
        away = np.hypot((u - centre[0]) * rng.uniform(0.8, 1.2), v - centre[1]) / radius
        texture = mix(texture, [0.95, 0.74, 0.30], 0.7 * np.exp(-(((away - 1.25) / 0.28) ** 2)))
        texture = mix(texture, [0.16, 0.06, 0.03], np.clip(2.5 * (1.1 - away), 0.0, 0.93))
    return texture
