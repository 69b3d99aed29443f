"""A thin sheet from an observation: mesh, material, and its path through the clip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ....conventions import frame_named, in_units
from ....errors import ObjectError
from ....materials import Sheet
from ....progress import Journal, NoProgress, Progress
from ....records import Attachment, Body, Gaussians, Observation, Particles, Surface, TrackTargets
from ..motion.lifting import Sight
from ..shape.relief import Relief, sheet_relief
from .follow import FEWEST, Followed, follow
from .mesh import SheetMesh, flatten_mesh, mesh_of
from .riding import ride_flat

FACING = 1e-6
"""Relative difference between a sheet's depths below which a single distance was given for it, not a depth map."""


@dataclass(frozen=True)
class SheetBuilt:
    """A sheet: a `records.Body` without its look."""

    mesh: SheetMesh
    sheet: Sheet
    name: str
    """The material's."""
    seen: Followed
    """The sheet's path, and the places of the tracks on it."""
    relief: Relief
    """Front of the object in frame 0, for `look.dress`."""
    told: tuple[str, ...] = ()
    """See `records.Body`."""

    @property
    def particles(self) -> Particles:
        """The vertices as particles, each with its share of the sheet's volume."""
        return Particles(self.mesh.x, self.mesh.areas() * self.sheet.thickness, self.mesh.pinned, self.mesh.spacing)

    def body(self, gaussians: Gaussians) -> Body:
        """The body with its look."""
        own = Attachment(np.arange(len(self.mesh.x), dtype=np.int32)[:, None], np.ones((len(self.mesh.x), 1)))
        height, width = self.relief.mask.shape
        uv = np.stack([(self.mesh.xy[:, 0] + 0.5) / width, 1.0 - (self.mesh.xy[:, 1] + 0.5) / height], axis=1)
        surface = Surface(self.mesh.x, self.mesh.faces.astype(np.int32), np.clip(uv, 0.0, 1.0), own)
        places, seen = self.seen.places[0], self.seen
        placed = np.isfinite(places[:, 0])
        keypoints = ride_flat(np.where(placed[:, None], places, self.mesh.flat[0]), self.mesh.flat)
        lifted = np.where(placed[:, None], keypoints.follow(seen.path), np.nan)
        solid = self.sheet.as_solid(self.name)
        body = Body(self.particles, solid, gaussians, surface, keypoints, lifted, sheet=self.sheet, told=self.told)
        return replace(body, path=seen.path, path_sigma=seen.sigma, measured=seen.measured)


def build_sheet(
    observation: Observation, sheet: Sheet, name: str, count: int, progress: Progress, journal: Journal
) -> SheetBuilt:
    """Mesh and path of a sheet.

    Args:
        sheet: its properties; name: the material's; count: about how many vertices.
        journal: keeps the frames that were followed so far.

    Raises:
        ObjectError: fewer than three frames, no object in frame 0, too few pixels or tracks, or no depth on it.
        Cancelled: between frames.
    """
    if observation.frames < 2:
        raise ObjectError(f"A sheet needs at least 3 frames; these are {observation.frames + 1}.", "Give a longer range with --frames.")
    relief = sheet_relief(observation, sheet.thickness)
    if np.ptp(relief.front[relief.mask]) < FACING * relief.front[relief.mask].max():
        progress.warn(
            "No depth was measured, so the sheet is taken to be flat and to face the camera in frame 0. If it does not, its lengths are "
            "wrong, and so is the wind. Give --depth, or begin at a frame where it does."
        )
    mesh = mesh_of(relief, observation.pin, count)
    progress.update(0.05, f"a sheet of {len(mesh.x)} vertices, {1e3 * mesh.spacing:.1f} mm apart")
    seen = follow(mesh, [sight_of(observation)], observation.fps, observation.masks, progress.part(0.05, 1.0), journal)
    _tell_blind(observation, seen.places[0], progress)
    placed = int(np.isfinite(seen.places[0][:, 0]).sum())
    progress.update(1.0, f"{placed} tracks on the sheet, which locate it to within {in_units(np.median(seen.sigma), 'm', 2)}")
    return SheetBuilt(mesh, sheet, name, seen, relief)


def _tell_blind(observation: Observation, places: np.ndarray, progress: Progress) -> None:
    """Warn of frames in which too few points on the sheet are seen. `places`: (K, 2) [m], the tracks' places on it, NaN off it."""
    sight = sight_of(observation)
    seen = (sight.visible & np.isfinite(places[:, 0])).sum(axis=1)
    if sight.recognised is not None:
        seen += np.bincount(sight.recognised.frame, minlength=len(seen))
    blind = np.flatnonzero(seen < FEWEST)
    if blind.size:
        progress.warn(
            f"In {blind.size} of {len(seen)} frames, first in {frame_named(int(blind[0]))}, fewer than {FEWEST} tracked points lie on the "
            "sheet. Its path is guessed there, and so is the wind: leave these frames out with --frames, or give --tracks of your own."
        )


def sight_of(observation: Observation) -> Sight:
    """What the first camera saw; the silhouette's centroid is no point of a sheet."""
    seen = observation.visible & ~observation.on_centroid
    return Sight(observation.camera, observation.xy, seen, observation.sigma, observation.recognised)


def follow_views(
    observation: Observation, body: Body, targets: Sequence[TrackTargets], progress: Progress = NoProgress(), journal: Journal = Journal()
) -> Body:
    """The body of a sheet with its path estimated from all views together. Raises as `follow` does.

    Args:
        observation: the first view; targets: of the first view, then of further ones.
    """
    x, faces = body.surface.vertices, body.surface.triangles.astype(np.int64)
    mesh = SheetMesh(x, faces, observation.camera.project(x)[0], flatten_mesh(x, faces), body.particles.pinned)
    sights = [sight_of(observation), *(Sight(one.camera, one.xy, one.visible, one.sigma) for one in targets[1:])]
    seen = follow(mesh, sights, observation.fps, observation.masks, progress, journal)
    lifted = np.where(np.isfinite(body.lifted), body.keypoints.follow(seen.path), np.nan)
    return replace(body, path=seen.path, path_sigma=seen.sigma, measured=seen.measured, lifted=lifted)
