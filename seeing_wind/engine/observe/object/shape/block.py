"""A body of flat faces, whose visible sides show how far it reaches behind its front.

A plate or a post that is seen at an angle shows its edge: sides that go from the largest visible face, the *face*, back to the end of the
body. Where planes explain the measured front, the body is the prism behind the face: as deep as the sides reach, as wide as they and the
silhouette allow. A guessed thickness would be much worse, since a plate's bending stiffness grows with its third power.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ....masks import at_pixels, pixels_of
from ....records import Camera

FLATNESS = 0.02
"""Distance up to which a pixel is on a plane, in units of the square root of the visible area."""

ROUND = 2
"""Distance [px] from a seed, along rows and columns, of the pixels to which a plane is first fitted."""

SEEDS = 80
"""Number of seeds at which a plane is tried."""

MOST_PLANES = 4
"""Largest number of planes sought; a prism shows three."""

LEAST_SIDE = 0.03
"""Least fraction of the object's pixels that a side has."""

COVERAGE = 0.85
"""Least fraction of the object's pixels on the face and its sides; the planes of a body of another shape cover less."""

UPRIGHT = 0.35
"""Largest cosine between the normals of the face and of a side."""

EDGE_QUANTILE = 0.99
"""Quantile of the distances of a side's pixels behind the face that gives the depth: the outermost may be mixed with the background."""

REFITS = 4
"""How often a plane is fitted again to the pixels on it."""

STEPS = 96
"""Number of points along a ray that are tested for being inside the body."""


@dataclass(frozen=True)
class Plane:
    """A plane by a point and its unit normal, which points out of the body."""

    point: np.ndarray
    """(3,) [m]."""
    normal: np.ndarray
    """(3,)."""

    def behind(self, points: np.ndarray) -> np.ndarray:
        """Distance (...,) [m] of points (..., 3) [m] behind the plane."""
        return (self.point - points) @ self.normal


@dataclass(frozen=True)
class Block:
    """A prism: `face` extruded backwards by `depth`."""

    face: Plane
    sides: tuple[Plane, ...]
    depth: float
    """[m]."""
    tolerance: float
    """How uneven the faces are [m]."""
    camera: Camera
    mask: np.ndarray
    """(H, W) bool, the silhouette."""
    stretch: tuple[float, ...]
    """Per side, the width of the silhouette on the face, away from the side, over the body's: less than 1 if the far edge is rounded."""

    def frame(self) -> np.ndarray:
        """Unit vectors, the rows of (3, 3): across the first side and along it, both in the face, and the inward normal."""
        inward = -self.face.normal
        across = self.sides[0].normal - (self.sides[0].normal @ inward) * inward
        across /= np.linalg.norm(across)
        return np.stack([across, np.cross(inward, across), inward])

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Which of the points (..., 3) [m] are inside, (...,) bool."""
        behind = self.face.behind(points)
        seen = on_face = points + behind[..., None] * self.face.normal
        inside = (behind >= -self.tolerance) & (behind <= self.depth)
        for side, stretch in zip(self.sides, self.stretch, strict=True):
            away = side.behind(on_face)
            inside &= away >= -self.tolerance
            seen = seen + (away * (1.0 - stretch))[..., None] * side.normal
        return inside & self._at(self.mask, seen)

    def exits(self, front: np.ndarray) -> np.ndarray:
        """Depths (H, W) [m] where the pixels' rays leave the body that they enter at depth `front` (H, W) [m]; `front` off the mask."""
        xy, near = pixels_of(self.mask), front[self.mask]
        entry, ahead = self.camera.unproject(xy, near), self.camera.unproject(xy, near + 1.0)
        per_metre = self.face.behind(ahead) - self.face.behind(entry)
        far = near + np.maximum(self.depth - self.face.behind(entry), 0.0) / np.maximum(per_metre, 1e-6)
        # A ray that grazes the face leaves through a side, within the body's length.
        reach = np.linalg.norm(np.ptp(entry, axis=0)) + self.depth
        far = np.minimum(far, near + reach)
        share = np.arange(1, STEPS + 1) / STEPS
        depth = near[:, None] + share * (far - near)[:, None]
        inside = self.contains(self.camera.unproject(np.repeat(xy[:, None], STEPS, axis=1), depth))
        steps = np.where(inside.all(axis=1), STEPS, np.argmin(inside, axis=1) + 0.5)
        back = front.copy()
        back[self.mask] = near + steps / STEPS * (far - near)
        return back

    def held(self, points: np.ndarray, pin: np.ndarray) -> np.ndarray:
        """Which of the body's points (M, 3) [m] are held, (M,) bool: those straight behind a plane where `pin` (H, W) bool is on it."""
        result = np.zeros(len(points), bool)
        shown = self.shown()
        for number, plane in enumerate((self.face, *self.sides)):
            result |= self._at(pin & (shown == number), points + plane.behind(points)[:, None] * plane.normal)
        return result

    def shown(self) -> np.ndarray:
        """The plane (H, W) int that each pixel shows: the face (0) or a side (from 1), -1 off the mask.

        A ray enters a convex body at the last of the visible planes that it crosses.
        """
        xy = pixels_of(self.mask)
        origin, ahead = self.camera.unproject(xy, np.zeros(len(xy))), self.camera.unproject(xy, np.ones(len(xy)))
        planes = (self.face, *self.sides)
        entries = np.stack([one.behind(origin) / np.minimum((ahead - origin) @ one.normal, -1e-9) for one in planes])
        shown = np.full(self.mask.shape, -1)
        shown[self.mask] = entries.argmax(axis=0)
        return shown

    def _at(self, image: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Values (...,) of `image` (H, W) bool at the pixels where points (..., 3) [m] are seen; False outside the frame."""
        xy, depth = self.camera.project(points)
        return at_pixels(image, np.where(depth[..., None] > 0.0, xy, -1.0))


def find_block(front: np.ndarray, mask: np.ndarray, camera: Camera) -> Block | None:
    """The prism that a measured front shows; None if it is not a prism or shows no side.

    Args:
        front: (H, W) depth along the view axis of the visible surface [m].
        mask: (H, W) bool, the object.
    """
    points = np.zeros((*mask.shape, 3))
    points[mask] = camera.unproject(pixels_of(mask), front[mask])
    eye = camera.pose(0)[:3, 3]
    tolerance = FLATNESS * np.sqrt(mask.sum() * float(np.median(front[mask])) ** 2 / (camera.fx * camera.fy))
    left, planes, areas = mask.copy(), [], []
    for _ in range(MOST_PLANES):
        found = _largest_plane(points, left, eye, tolerance)
        if found is None:
            break
        on = left & (np.abs(found.behind(points)) < tolerance)
        if on.sum() < LEAST_SIDE * mask.sum():
            break
        planes.append((found, on))
        sight = points[on] - eye
        distance = np.linalg.norm(sight, axis=1)
        areas.append(float((distance**3 / np.maximum(np.abs(sight @ found.normal), 1e-3 * distance)).sum()))
        left &= ~on
    if len(planes) < 2:
        return None
    face, on_face = planes.pop(int(np.argmax(areas)))
    sides: list[tuple[Plane, np.ndarray]] = []
    for side, on in planes:  # a rounded edge between two sides can pass for a third one
        if all(abs(side.normal @ other.normal) < UPRIGHT for other in (face, *(one for one, _ in sides))):
            sides.append((side, on))
    behind = [face.behind(points[on]) for _, on in sides]
    if not sides or any(np.quantile(one, 1.0 - EDGE_QUANTILE) < -2.0 * tolerance for one in behind):
        return None
    if on_face.sum() + sum(on.sum() for _, on in sides) < COVERAGE * mask.sum():
        return None
    deepest = max(range(len(sides)), key=lambda number: np.quantile(behind[number], EDGE_QUANTILE))
    side, on_side = sides[deepest]
    depth = float(np.quantile(behind[deepest], EDGE_QUANTILE)) + _half_a_pixel(behind[deepest], on_side)
    pixel = float(np.median(front[mask])) / np.sqrt(camera.fx * camera.fy)
    depth += _hidden_edge(_radius(face, side, points[on_face | on_side], pixel), face, side, points[on_side].mean(axis=0) - eye)
    along = (points[mask] - eye) @ face.normal
    silhouette = eye + (points[mask] - eye) * (face.behind(eye) / np.minimum(along, -1e-9))[:, None]
    stretch = tuple(_stretch(face, one, _radius(face, one, points[on_face | on], pixel), silhouette, eye) for one, on in sides)
    return Block(face, tuple(one for one, _ in sides), depth, tolerance, camera, mask, stretch)


def _half_a_pixel(behind: np.ndarray, on: np.ndarray) -> float:
    """How much deeper [m] a side ends than at the centres of its outermost pixels; behind: (n,) distances [m] behind the face of the pixels
    `on` (H, W) bool."""
    pixels = np.argwhere(on)
    slope = np.linalg.lstsq(np.column_stack([pixels, np.ones(len(pixels))]), behind, rcond=None)[0][:2]
    return 0.5 * float(np.linalg.norm(slope))


def _radius(face: Plane, side: Plane, points: np.ndarray, pixel: float) -> float:
    """Radius [m] of the edge between a face and a side, from points (n, 3) [m] on them; 0 if it is less than a `pixel` [m], which cannot be
    resolved."""
    # Let a and b be the distances behind two planes at right angles. On the arc between the planes, a + b is least half-way, (2 - sqrt 2)
    # radii. At a sharp edge its minimum is 0, though no pixel may lie there: a line through two quantiles extrapolates to the minimum.
    share = 1.0 - EDGE_QUANTILE
    few, more = np.quantile(face.behind(points) + side.behind(points), (share, 2.0 * share))
    radius = float(2.0 * few - more) / (2.0 - float(np.sqrt(2.0)))
    return radius if radius > pixel else 0.0


def _hidden_edge(radius: float, face: Plane, side: Plane, sight: np.ndarray) -> float:
    """How much deeper [m] a body with rounded edges reaches than its silhouette; the far edge is taken to be as round as the near one.

    The silhouette is where the line of sight `sight` (3,) touches the arc of the far edge.
    """
    touched = np.arctan2(-sight @ side.normal, -sight @ face.normal)
    return radius * (1.0 - float(np.sin(touched)))


def _stretch(face: Plane, side: Plane, radius: float, silhouette: np.ndarray, eye: np.ndarray) -> float:
    """Width of the silhouette on the face over the body's width, both away from a side; the opposite edge is taken to be as round.

    Args:
        radius: of the edge [m].
        silhouette: (n, 3) where the rays of all of the object's pixels cross the plane of the face [m]; eye: (3,) the camera's place [m].
    """
    away = side.behind(silhouette)
    farthest = int(np.argmax(away))
    sight = silhouette[farthest] - eye
    forward, aside = -sight @ face.normal, -sight @ side.normal
    touched = np.arctan2(aside, forward)
    # The line of sight touches the arc before the arc's end, and crosses the plane of the face even before that.
    lost = radius * (1.0 - np.cos(touched)) + radius * (1.0 - np.sin(touched)) * aside / max(forward, 1e-9)
    seen = max(float(away[farthest]), 1e-9)
    return seen / (seen + float(lost))


def _largest_plane(points: np.ndarray, left: np.ndarray, eye: np.ndarray, tolerance: float) -> Plane | None:
    """The plane with the most of the pixels `left` (H, W) bool on it; None if these are nowhere wide enough to fit a plane.

    points: (H, W, 3) [m]; eye: (3,) the camera's place [m]; tolerance: distance up to which a pixel is on a plane [m].
    """
    inside = ndimage.binary_erosion(left, iterations=ROUND)
    seeds = np.argwhere(inside)
    if len(seeds) == 0:
        return None
    cloud, best, most = points[left], _fit_plane(points[inside], eye), 0
    for row, column in seeds[:: max(1, len(seeds) // SEEDS)]:
        near = points[row - ROUND : row + ROUND + 1, column - ROUND : column + ROUND + 1]
        known = left[row - ROUND : row + ROUND + 1, column - ROUND : column + ROUND + 1]
        plane = _fit_plane(near[known], eye)
        count = int((np.abs(plane.behind(cloud)) < tolerance).sum())
        if count > most:
            best, most = plane, count
    for _ in range(REFITS):
        # Parts of rounded edges lie within the tolerance, too, and would tilt the plane, so it is fitted to the flat middle only.
        off = np.abs(best.behind(cloud))
        band = max(3.0 * float(np.median(off[off < tolerance])), 0.05 * tolerance)
        best = _fit_plane(cloud[off < min(band, tolerance)], eye)
    return best


def _fit_plane(points: np.ndarray, eye: np.ndarray) -> Plane:
    """The least-squares plane through points (n, 3) [m], with its normal towards the eye (3,) [m]."""
    centre = points.mean(axis=0)
    normal = np.linalg.eigh((points - centre).T @ (points - centre))[1][:, 0]
    return Plane(centre, normal if normal @ (eye - centre) > 0.0 else -normal)
