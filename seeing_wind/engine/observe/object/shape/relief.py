"""The body in frame 0 as two depth maps: the visible surface and a guessed back.

A single frame only shows a front. The back is guessed by rules that a user can check, and override with a thickness:

- a measured front of flat faces that shows the sides of a plate or post is the block that these sides bound (`block`),
- a silhouette that is hardly larger than its inscribed circle is a ball (unless a measured depth contradicts), with the rest of the sphere
  behind it; a given thickness much less than the diameter makes it a disc,
- a measured front that bulges towards the camera gets a back that bulges by as much (`inflate`),
- where no depth was measured, a silhouette that is held and has a stem between the held part and its widest place is a body of `parts`,
- a silhouette much longer than broad is a post, as thick as it is broad, and round where no depth was measured; a given thickness much
  less than the breadth makes it a strip,
- everything else is a plate, a few percent of its size thick.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import ndimage

from ....conventions import in_units
from ....errors import ObjectError
from ....masks import pixels_of
from ....records import Camera, Observation
from ...clip.depth import filled, nearest_known
from .block import Block, find_block
from .inflate import LEAK, balls, from_rim, inflate
from .parts import Parts, parts_of

MIN_PIXELS = 16
"""Fewer pixels than this carry no shape."""

SPECK = 0.02
"""Components of the mask smaller than this fraction of the largest one are noise."""

ROUND = 0.82
"""Area of the inscribed circle over that of the silhouette from which it is round: 1 for a disc, 0.785 for a square."""

LONG = 4.0
"""Length over breadth from which a silhouette is a post."""

ROUNDEST, OFF_CIRCLE, FEW = (0.7, 1.4), 1.15, 0.03
"""A measured front is a ball's if its bulge lies in ROUNDEST and less than the fraction FEW of its pixels is more than OFF_CIRCLE inscribed
radii from the centre."""

BULGE = 0.35
"""Rise of a front over its rim from which the body is solid, relative to that of a round one: 1 for a ball, about 0 for a plate."""

PLATE_THICKNESS = 0.05
"""Thickness of a plate in units of the square root of its area: thick enough for the solver's grid, thin to the eye."""

THINNEST = 0.5
"""Least thickness of a ball's rim, in widths of a pixel: its outline on whole pixels reaches a little beyond the sphere's."""

DISC = 0.5
"""Given thickness, in units of the diameter, below which a round silhouette is a disc's and that of a post a strip's."""

STRAY = 3.0
"""Depths outside the 5th to 95th percentile by more than this many times the distance between these are not the object's."""

MAX_SLANT = 3.0
"""Cap on 1 / cos(slant) where a surface turns edge-on."""


@dataclass(frozen=True)
class Relief:
    """A body between two depth maps, which are filled with the nearest values off the mask, so that they can be interpolated there."""

    mask: np.ndarray
    """(H, W) bool, specks removed."""
    front: np.ndarray
    """(H, W) depth along the view axis of the visible surface [m]."""
    back: np.ndarray
    """(H, W) depth of the back [m]."""
    camera: Camera
    kind: str
    """block, ball, parts, solid, post, plate or sheet."""
    thickness: float
    """The body's thickness [m]: a plate's or a measured post's median along the view axis, a block's behind its face, else the largest."""
    block: Block | None = None
    """The prism, if the body is a block."""
    parts: Parts | None = None
    """Stem, head and sheets, if it is a body of parts."""

    def points(self, xy: np.ndarray, across: np.ndarray | float) -> np.ndarray:
        """World points (..., 3) [m] at pixels xy (..., 2), where `across` (...,) is 0 on the front and 1 on the back."""
        front, back = sample(self.front, xy), sample(self.back, xy)
        return self.camera.unproject(xy, front + across * (back - front))

    def pixel_volume(self) -> np.ndarray:
        """Volume (H, W) [m³] of the body behind each pixel, a frustum between front and back; 0 off the mask. Read-only."""
        return self._volume

    @cached_property
    def _volume(self) -> np.ndarray:
        volume = (self.back**3 - self.front**3) / (3.0 * self.camera.fx * self.camera.fy)
        return np.where(self.mask, volume, 0.0)


def check_thickness(thickness: float, distance: float) -> None:
    """Raise ObjectError if a thickness [m] is not positive, or larger than the body's distance from the camera [m]."""
    if not (np.isfinite(thickness) and thickness > 0.0):
        raise ObjectError(f"The thickness {thickness} is no positive number of metres.", "Give metres behind the visible surface.")
    if thickness > distance:
        raise ObjectError(
            f"The thickness {in_units(thickness, 'm')} is more than the body's distance from the camera, {in_units(distance, 'm')}.",
            "Give metres behind the visible surface.",
        )


def relief_of(observation: Observation, thickness: float | None = None) -> Relief:
    """Front and back of the observed object in frame 0.

    Args:
        thickness: metres between front and back, or None for a guess.

    Raises:
        ObjectError: the mask is empty or too small, the depth is missing on most of it, or the thickness is not positive or beyond the
            distance.
    """
    mask = clean_mask(observation.masks[0])
    front, flat = _front(observation, mask)
    camera = observation.camera
    rim = from_rim(mask)
    # The outline of a solid body is seen at the depth of its rim, not at that of its nearest point.
    band = mask & (rim > LEAK) & (rim < 0.05 * rim.max() + LEAK + 1.0)
    metre_per_pixel = float(np.median(front[band if band.any() else mask])) / np.sqrt(camera.fx * camera.fy)
    area, radius = float(mask.sum()) * metre_per_pixel**2, float(rim.max()) * metre_per_pixel
    block = None if flat else find_block(front, mask, camera)
    rounded = None if flat or block is not None else inflate(front, mask, metre_per_pixel)
    kind = _kind(mask, rim, front, None if rounded is None else rounded.bulge, camera) if block is None else "block"
    distance = float(np.median(front[mask]))
    if thickness is not None:
        check_thickness(thickness, distance)
    if block is not None:
        block = block if thickness is None else replace(block, depth=thickness)
        nearest = nearest_known(mask)
        front = front[nearest]
        return Relief(mask, front, block.exits(front)[nearest], camera, kind, block.depth, block)
    parts = parts_of(mask, observation.pin) if flat and kind != "ball" else None
    if parts is not None:
        half, nearest = _half(parts, metre_per_pixel, thickness), nearest_known(mask)
        return Relief(mask, (front - half)[nearest], (front + half)[nearest], camera, "parts", 2.0 * float(half.max()), parts=parts)
    if kind in ("ball", "post") and flat and thickness is not None and thickness < DISC * 2.0 * radius:
        kind = "plate"
    if kind == "ball":
        near, far = sphere_depths(mask, camera)
        # A single distance is that of the body's middle; a measured front gives the middle best where it faces the camera.
        middle = distance if flat else float(np.median((front / near)[mask & (rim > 0.5 * rim.max())]))
        front = middle * near if flat else front
        largest = float((far - near)[mask].max()) * middle
        profile = np.maximum(middle * far - front, THINNEST * metre_per_pixel) * (1.0 if thickness is None else thickness / largest)
    elif kind == "post" and flat:
        half = np.maximum(balls(mask).half, 0.5 * THINNEST) * metre_per_pixel * (1.0 if thickness is None else 0.5 * thickness / radius)
        front, profile = front + np.median(half[mask]) - half, 2.0 * half
    elif kind == "solid":
        assert rounded is not None  # only a measured front bulges
        profile = rounded.thickness * (1.0 if thickness is None else thickness / rounded.thickness.max())
    else:
        guess = 2.0 * radius if kind == "post" else PLATE_THICKNESS * np.sqrt(area)
        profile = (guess if thickness is None else thickness) * slant(front, camera)
    nearest = nearest_known(mask)
    front, back = front[nearest], (front + profile)[nearest]
    even = kind == "plate" or (kind == "post" and not flat)
    return Relief(mask, front, back, camera, kind, float(np.median(profile[mask]) if even else profile[mask].max()))


def area_of(observation: Observation) -> float:
    """Area [m²] of the object in frame 0, projected across the view. Raises ObjectError as `relief_of` does."""
    mask, camera = clean_mask(observation.masks[0]), observation.camera
    return float((_front(observation, mask)[0][mask] ** 2).sum()) / (camera.fx * camera.fy)


def sheet_relief(observation: Observation, thickness: float) -> Relief:
    """A thin sheet in frame 0 of the given thickness [m]. Raises ObjectError as `relief_of` does."""
    mask = clean_mask(observation.masks[0])
    front = _front(observation, mask)[0]
    nearest = nearest_known(mask)
    back = (front + thickness * slant(front, observation.camera))[nearest]
    return Relief(mask, front[nearest], back, observation.camera, "sheet", thickness)


def _half(parts: Parts, pixel: float, thickness: float | None) -> np.ndarray:
    """Half the depth (H, W) [m] of a body of parts. pixel: a pixel's width [m]; thickness: the head's, and the largest of a sheet [m]."""
    half = np.maximum(parts.half(), 0.5 * THINNEST) * pixel
    if thickness is not None:
        half[parts.head] *= 0.5 * thickness / half[parts.head].max()
    for number in range(1, parts.sheets.max() + 1):
        sheet = parts.sheets == number
        guess = PLATE_THICKNESS * np.sqrt(sheet.sum()) * pixel
        half[sheet] = 0.5 * (guess if thickness is None else min(guess, thickness))
    return half


def sphere_depths(mask: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Depths where the pixels' rays enter and leave the sphere with the silhouette `mask` (H, W) bool whose middle is at depth 1.

    A sphere is seen as a circular cone of half angle alpha about the ray to its middle. The mask's solid angle, 2 pi (1 - cos alpha), and
    mean direction give the cone; the radius is sin(alpha) times the distance. Rays that miss the sphere take their point nearest to it.

    Returns:
        depths (H, W) along the view axis of the near side and of the far side.
    """
    rows, columns = np.mgrid[: mask.shape[0], : mask.shape[1]].astype(float)
    ray = np.stack([(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(mask.shape)], axis=-1)
    length = np.linalg.norm(ray, axis=-1)
    solid_angle = np.where(mask, length**-3 / (camera.fx * camera.fy), 0.0)
    axis = (solid_angle[..., None] * ray / length[..., None]).sum(axis=(0, 1))
    middle = axis / axis[2]
    cosine = 1.0 - solid_angle.sum() / (2.0 * np.pi)
    square = middle @ middle * (1.0 - cosine**2)  # the radius, squared
    along = ray @ middle / length**2
    half = np.sqrt(np.maximum(along**2 - (middle @ middle - square) / length**2, 0.0))
    return along - half, along + half


def clean_mask(mask: np.ndarray) -> np.ndarray:
    """The mask (H, W) without specks.

    Raises:
        ObjectError: no object, or too few pixels of it.
    """
    mask = np.asarray(mask, dtype=bool)
    labels, count = ndimage.label(mask, structure=np.ones((3, 3)))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[0] = 0
    if count == 0:
        raise ObjectError("The mask of the first frame is empty.", "Give a --mask or a --box round the object.")
    kept = sizes >= SPECK * sizes.max()
    kept[0] = False
    result = kept[labels]
    if result.sum() < MIN_PIXELS:
        raise ObjectError(
            f"The object has only {int(result.sum())} pixels in the first frame; at least {MIN_PIXELS} are needed.",
            "Use a clip of higher resolution, or crop it round the object.",
        )
    return result


def sample(image: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Values (...,) of an image (H, W) at pixels xy (..., 2), interpolated bilinearly and clamped to the frame."""
    return ndimage.map_coordinates(image, [xy[..., 1], xy[..., 0]], order=1, mode="nearest")


def slant(front: np.ndarray, camera: Camera) -> np.ndarray:
    """1 / cos of the angle between the surface and the image plane, (H, W), at most `MAX_SLANT`; smoothed over a few pixels."""
    smooth = ndimage.gaussian_filter(front, 2.0)
    rise_y, rise_x = np.gradient(smooth)
    slope = np.hypot(rise_x * camera.fx / smooth, rise_y * camera.fy / smooth)
    return np.minimum(np.sqrt(1.0 + slope**2), MAX_SLANT)


def _front(observation: Observation, mask: np.ndarray) -> tuple[np.ndarray, bool]:
    """Depth (H, W) [m] of the visible surface with its holes filled, and whether it is constant, so that no depth was measured."""
    depth = np.asarray(observation.depth, dtype=np.float64)
    if depth.shape != mask.shape:
        raise ObjectError(f"The depth map is {depth.shape[::-1]}, the frame {mask.shape[::-1]}.", "Give a depth map of the clip's size.")
    known = mask & np.isfinite(depth) & (depth > 0.0)
    if known.any():  # depths far from all the rest are not the object's
        low, high = np.percentile(depth[known], (5.0, 95.0))
        apart = STRAY * max(high - low, 0.01 * high)
        known &= (depth > low - apart) & (depth < high + apart)
    if known.sum() < 0.5 * mask.sum():
        raise ObjectError(
            f"The depth map is empty on {100 - 100 * known.sum() / mask.sum():.0f} % of the object.",
            "Give a depth map in metres that covers the object, or --distance.",
        )
    return filled(depth, known), bool(np.ptp(depth[known]) <= 1e-6 * depth[known].max())


def _kind(mask: np.ndarray, rim: np.ndarray, front: np.ndarray, bulge: float | None, camera: Camera) -> str:
    """The kind of body, ball, solid, post or plate: see the module's docstring. `bulge`: `Inflated`'s, None if no depth was measured."""
    xy = pixels_of(mask)
    if np.pi * rim.max() ** 2 / len(xy) > ROUND and (bulge is None or (ROUNDEST[0] < bulge < ROUNDEST[1] and _is_disc(rim, xy))):
        return "ball"
    if bulge is not None and bulge > BULGE:
        return "solid"
    spread = np.linalg.eigvalsh(np.cov(camera.unproject(xy, front[mask]).T))
    return "post" if spread[2] > LONG**2 * max(spread[1], 0.0) else "plate"


def _is_disc(rim: np.ndarray, xy: np.ndarray) -> bool:
    """Whether hardly any of the pixels xy (P, 2) are outside the inscribed circle: a lamp on a stick is not a ball."""
    centre = np.array(np.unravel_index(int(rim.argmax()), rim.shape))[::-1]
    return bool((np.linalg.norm(xy - centre, axis=1) > OFF_CIRCLE * rim.max() + 1.0).mean() < FEW)
