"""Stage *build*: from an observation to a body that physics can move (paper, section 3.1)."""

from __future__ import annotations

import dataclasses

import numpy as np

from ...look.gaussians import pixel_aligned
from ...materials import PLASTIC_LAWS, adjusted, find
from ...progress import NoProgress, Progress
from ...records import Body, Observation, Particles, Surface
from ...settings import FLOWING_PARTICLES, PARTICLES, BuildSettings
from .motion.keypoints import held, place, ride
from .motion.late import among, tie
from .motion.lifting import Arap, lift
from .shape.particles import fill
from .shape.relief import Relief, relief_of
from .shape.surface import surface_of

POOR_LOOK = 25.0
"""PSNR [dB] under which the user is told that the Gaussians do not show the object well."""


def build(observation: Observation, settings: BuildSettings | None = None, progress: Progress | None = None) -> Body:
    """Particles, material, Gaussians, surface and key points of the object in picture 0.

    Args:
        observation: what was seen; settings: material, thickness, number of particles.

    Raises:
        MaterialError: an unknown material or numbers that are not physical.
        ObjectError: no object in picture 0, too few pixels, no depth on it, or a pin off the object.
        Cancelled: at a safe point, when the user asked to stop.
    """
    settings, progress = settings or BuildSettings(), progress or NoProgress()
    material = adjusted(
        find(settings.material),
        law=settings.law,
        density=settings.density,
        youngs_modulus=settings.youngs_modulus,
        poisson_ratio=settings.poisson_ratio,
        yield_stress=settings.yield_stress,
        viscosity=settings.viscosity,
    )
    if settings.estimated_material is not None:
        source = f"estimated for {settings.estimated_by}"
        material = dataclasses.replace(material, name=settings.estimated_material, source=source)
    relief = relief_of(observation, settings.thickness)
    flows = material.law in PLASTIC_LAWS
    count = settings.particles if settings.particles is not None else FLOWING_PARTICLES if flows else PARTICLES
    particles = fill(relief, count, observation.pin)
    progress.update(0.05, f"{len(particles.x)} particles in a {relief.kind}, {1000.0 * relief.thickness:.1f} mm thick")
    surface = surface_of(relief, particles.x)
    points, tie_sigma = _key_points(observation, relief, particles, surface, progress)
    keypoints = ride(points, observation.on_centroid, particles)
    # A body that flows forgets picture 0: its neighbourhoods are compared with the previous picture.
    arap: Arap = "previous" if flows else "rest"
    visible = observation.visible & np.isfinite(points).all(axis=1)
    sigma = np.hypot(observation.sigma, tie_sigma)
    lifted = lift(observation.camera, observation.xy, visible, sigma, points, held(observation, points), arap, progress)
    progress.update(0.2, f"{len(points)} key points lifted, surface of {len(surface.vertices)} vertices")
    from ...look.first_frame import fit  # brings torch: here, so that the rest of this room loads fast

    rough = pixel_aligned(relief, observation.image, particles.x)
    share, behind = _Share(progress, 0.2, 1.0), observation.background
    gaussians, quality = fit(rough, relief, observation.image, progress=share, behind=behind)
    if quality < POOR_LOOK:
        progress.warn(f"The Gaussians show the object with {quality:.1f} dB only; forces do not depend on it.")
    progress.update(1.0, f"{len(gaussians.x)} Gaussians, {quality:.1f} dB", psnr=round(quality, 2))
    return Body(
        particles=particles,
        material=material,
        gaussians=gaussians,
        surface=surface,
        keypoints=keypoints,
        lifted=lifted,
        tie_sigma=tuple(tie_sigma.tolist()),
    )


def _key_points(
    observation: Observation, relief: Relief, particles: Particles, surface: Surface, progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """Key points (K, 3) in picture 0 [m], NaN for tracks without a place, and the standard deviation of a later one's place (K,) [px]."""
    points = place(observation, relief, particles)
    seen = observation.visible & np.isfinite(observation.xy).all(axis=-1)
    first = np.where(seen.any(axis=0) & ~observation.on_centroid, seen.argmax(axis=0), -1)
    apart = (first > 0) & ~among(observation, first)
    if not apart.any():
        return points, np.zeros(len(points))
    ties, sigma = tie(observation, surface, points, np.where(apart | (first == 0), first, -1), progress)
    placed = apart & np.isfinite(ties).all(axis=1)
    progress.update(0.1, f"{int(placed.sum())} of {int(apart.sum())} later tracks tied to the body")
    return np.where(apart[:, None], ties, points), np.where(placed, sigma, 0.0)


class _Share(Progress):
    """A part, `begin`..`end`, of another progress."""

    def __init__(self, whole: Progress, begin: float, end: float) -> None:
        super().__init__()
        self._whole, self._begin, self._end = whole, begin, end

    def update(self, fraction: float, message: str = "", **figures: float) -> None:
        self._whole.update(self._begin + fraction * (self._end - self._begin), message, **figures)

    def check(self) -> None:
        self._whole.check()
