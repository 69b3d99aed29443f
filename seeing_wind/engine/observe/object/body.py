"""The stage *build*: from an observation to a body that the solver can move (paper, section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...errors import ObjectError
from ...materials import PLASTIC_LAWS, Material, Sheet
from ...progress import Journal, NoProgress, Progress
from ...records import Attachment, Body, Gaussians, Observation, Particles, Surface
from ...settings import FLOWING_PARTICLES, PARTICLES, SHEET_VERTICES, BuildSettings
from ...settings.build import material_of, part_materials, sheet_of
from ..mask.cutting import opened
from .motion.keypoints import held, place, ride
from .motion.late import amid_guides, tie
from .motion.lifting import Sight, lift
from .shape.on_stem import too_fine, top_heavy, widening
from .shape.particles import fill
from .shape.parts import Parts
from .shape.relief import Relief, area_of, relief_of
from .shape.surface import surface_of
from .sheet import FEWEST, SheetBuilt, build_sheet, too_few

EDGE = 7
"""Thickness [px] of the object in frame 0, a strip, below which no sheet is told from its edge; odd."""
LIMP = 0.1
"""Bending length of cloth, in units of its size, below which it hangs in folds: the length over which its own weight bends it."""


@dataclass(frozen=True)
class Built:
    """A solid body: a `records.Body` without its look."""

    particles: Particles
    material: Material
    surface: Surface
    keypoints: Attachment
    lifted: np.ndarray
    """(T+1, K, 3) [m], see `records.Body`."""
    tie_sigma: tuple[float, ...]
    """(K,) [px], see `records.Body`."""
    relief: Relief
    """Front and back of the object in frame 0, for `look.dress`."""
    told: tuple[str, ...] = ()
    """See `records.Body`."""
    top_heavy: str = ""
    """See `records.Body`."""

    def body(self, gaussians: Gaussians) -> Body:
        """The body with its look."""
        return Body(
            self.particles, self.material, gaussians, self.surface, self.keypoints, self.lifted, self.tie_sigma, told=self.told,
            top_heavy=self.top_heavy,
        )  # fmt: skip


@dataclass(frozen=True)
class Rest:
    """A solid body at rest, without its motion."""

    material: Material
    particles: Particles
    relief: Relief
    told: tuple[str, ...]
    """See `records.Body`."""
    top_heavy: str
    """See `records.Body`."""


def build(
    observation: Observation, settings: BuildSettings = BuildSettings(), progress: Progress = NoProgress(), journal: Journal = Journal()
) -> Built | SheetBuilt:
    """Particles, material, surface and key points of the object in frame 0; for a thin sheet also its path through the clip.

    Args:
        observation: what was seen; settings: material, form, thickness, number of particles.
        journal: keeps the frames that were lifted so far.

    Raises:
        MaterialError: an unknown material, unphysical numbers, or a material that cannot be a sheet.
        ObjectError: no object in frame 0, too few pixels, no depth on it, or a pin off the object.
    """
    material = part_materials(settings).stem
    sheet = _sheet(observation, settings, material, progress)
    if sheet is not None:
        built = build_sheet(observation, sheet, material.name, settings.particles or SHEET_VERTICES, progress, journal)
        return replace(built, told=_unused(settings, None))
    rest = _at_rest(observation, settings, progress)
    relief, particles = rest.relief, rest.particles
    fine = None if relief.parts is None else too_fine(relief.parts)
    if fine is not None:
        progress.warn(fine)
    progress.update(0.25, f"{len(particles.x)} particles in a {_describe(relief, particles)}, {1000.0 * relief.thickness:.1f} mm thick")
    surface = surface_of(relief, particles.x)
    points, tie_sigma = _key_points(observation, relief, particles, surface, progress)
    keypoints = ride(points, observation.on_centroid, particles)
    visible = observation.visible & np.isfinite(points).all(axis=1)
    sigma = np.hypot(observation.sigma, tie_sigma)
    sight = Sight(observation.camera, observation.xy, visible, sigma)
    lifted = lift([sight], points, held(observation, points), material.law in PLASTIC_LAWS, progress, journal)
    progress.update(1.0, f"{len(points)} key points lifted, surface of {len(surface.vertices)} vertices")
    return Built(
        particles=particles,
        material=material,
        surface=surface,
        keypoints=keypoints,
        lifted=lifted,
        tie_sigma=tuple(tie_sigma.tolist()),
        relief=relief,
        told=rest.told,
        top_heavy=rest.top_heavy,
    )


def _at_rest(observation: Observation, settings: BuildSettings, progress: Progress) -> Rest:
    """A solid in frame 0. Raises as `build` does."""
    materials, relief = part_materials(settings), relief_of(observation, settings.thickness)
    material, parts = materials.stem, relief.parts
    usual = FLOWING_PARTICLES if material.law in PLASTIC_LAWS else PARTICLES
    count = usual if settings.particles is None else settings.particles
    progress.update(0.05, f"filling a {relief.kind if relief.parts is None else 'body on a stem'} with particles")
    frame_dt = 1.0 / observation.fps
    wider = 1.0 if parts is None else widening(relief, parts, materials, frame_dt)
    particles = fill(relief, count, observation.pin, progress, wider, materials, frame_dt)
    heavy = "" if parts is None else top_heavy(relief, parts, particles, observation.pin, materials)
    return Rest(material, particles, relief, _unused(settings, parts), heavy)


def _unused(settings: BuildSettings, parts: Parts | None) -> tuple[str, ...]:
    """Notes on materials that were given for parts that the body lacks."""
    given = [flag for flag, name in (("--head-material", settings.head_material), ("--leaf-material", settings.leaf_material)) if name]
    if given and parts is None:
        return (
            f"{' and '.join(given)} had no effect: no stem was found that leads from a held place to something broader, so all of the "
            "object has one material. Mark the stem's foot as held, or leave this out.",
        )
    if settings.leaf_material and parts is not None and not parts.sheets.any():
        return ("--leaf-material had no effect: no leaf was found beside the stem.",)
    return ()


def rest_body(observation: Observation, settings: BuildSettings) -> Rest | None:
    """The body that `build` would make, without its motion; None for a thin sheet. Raises as `build` does."""
    if _sheet(observation, settings, material_of(settings), NoProgress()) is not None:
        return None
    return _at_rest(observation, settings, NoProgress())


def _sheet(observation: Observation, settings: BuildSettings, material: Material, progress: Progress) -> Sheet | None:
    """The properties of the sheet that the object is built as; None for a solid.

    Raises:
        MaterialError: as `sheet_of`. ObjectError: a sheet is asked for, but the object does not show its shape.
    """
    sheet = sheet_of(settings)
    if sheet is None or (settings.form != "sheet" and sheet.bending_length > LIMP * np.sqrt(area_of(observation))):
        return None
    tracks = int((observation.visible[0] & ~observation.on_centroid).sum())
    thin = not opened(np.asarray(observation.masks[0]), EDGE).any()
    if not thin and tracks >= FEWEST:
        return sheet
    if settings.form != "sheet":
        why = f"it is less than {EDGE} pixels thick in frame 0" if thin else f"only {tracks} points of it are tracked"
        progress.warn(f"{material.name} hangs in folds, but {why}: it is built as a solid.")
        return None
    if thin:
        raise ObjectError(
            f"The sheet is less than {EDGE} pixels thick in frame 0, as if seen edge-on: its shape does not show.",
            "Begin where it shows its face, film it closer, or recover it with --form solid.",
        )
    raise too_few(tracks)


def _describe(relief: Relief, particles: Particles) -> str:
    """The kind of body, in words."""
    if relief.parts is None:
        return relief.kind
    count = int(relief.parts.sheets.max())
    stem = f"body on a stem {2000.0 * particles.spacing:.1f} mm thick"
    return stem + (f" with {count} sheet{'s' if count > 1 else ''}" if count else "")


def _key_points(
    observation: Observation, relief: Relief, particles: Particles, surface: Surface, progress: Progress
) -> tuple[np.ndarray, np.ndarray]:
    """Key points (K, 3) in frame 0 [m], NaN for tracks without a place on the body, and the standard deviation of the place (K,) [px], 0
    for tracks that begin in frame 0."""
    points = place(observation, relief, particles)
    seen = observation.visible & np.isfinite(observation.xy).all(axis=-1)
    first = np.where(seen.any(axis=0) & ~observation.on_centroid, seen.argmax(axis=0), -1)
    apart = (first > 0) & ~amid_guides(observation, first)
    if not apart.any():
        return points, np.zeros(len(points))
    ties, sigma = tie(observation, surface, points, np.where(apart | (first == 0), first, -1), progress)
    placed = apart & np.isfinite(ties).all(axis=1)
    progress.update(0.5, f"{int(placed.sum())} of {int(apart.sum())} later tracks tied to the body")
    return np.where(apart[:, None], ties, points), np.where(placed, sigma, 0.0)
