"""One wind that several bodies were in: each felt it where it was, and what joins them is the prior.

The unknowns are the modes of the wind on each body, as for one body alone. Their covariance is that of one Gaussian process over the
places that all bodies passed, and one mean wind: the nearer two bodies, the more each tells of the air at the other. So a leaf that lies
along the wind, and hardly feels it, is told by its neighbour, and the field between them is that of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from ..prior.basis import SpatialBasis
from .felt import Felt


@dataclass(frozen=True)
class FeltTogether:
    """What several bodies felt in the same frames as one `Felt`: their data and their modes one after the other."""

    parts: tuple[Felt, ...]

    @cached_property
    def measured(self) -> np.ndarray:
        return np.concatenate([one.measured for one in self.parts], axis=1)

    @cached_property
    def deviation(self) -> np.ndarray:
        return np.concatenate([one.deviation for one in self.parts], axis=1)

    @property
    def net(self) -> np.ndarray:
        return np.concatenate([one.net for one in self.parts])

    @property
    def size(self) -> np.ndarray:
        """(D,) [m/s²]; a light body is accelerated more than a heavy one, and the drag law fails it by as much more."""
        return np.concatenate([one.size for one in self.parts])

    @property
    def modes(self) -> int:
        return sum(one.modes for one in self.parts)

    @property
    def uniform_modes(self) -> list[int]:
        """The first of each body."""
        return [rows.start for rows in _one_after_the_other([one.modes for one in self.parts])]

    def uniform(self) -> np.ndarray:
        """(T, 3) a first wind [m/s]: the mean of theirs."""
        first: np.ndarray = np.mean([one.uniform() for one in self.parts], axis=0)
        return first

    def predicted(self, wind: np.ndarray) -> np.ndarray:
        return np.concatenate([one.predicted(wind[:, rows]) for one, rows in self._with_modes()], axis=1)

    def slopes(self, wind: np.ndarray) -> np.ndarray:
        """(T, D, P, 3) [1/s]: a body feels the wind on itself only."""
        slopes = np.zeros((*self.measured.shape, self.modes, 3))
        data = _one_after_the_other([one.measured.shape[1] for one in self.parts])
        for (one, rows), own in zip(self._with_modes(), data, strict=True):
            slopes[:, own, rows] = one.slopes(wind[:, rows])
        return slopes

    def _with_modes(self) -> list[tuple[Felt, slice]]:
        return list(zip(self.parts, _one_after_the_other([one.modes for one in self.parts]), strict=True))


def basis_together(bases: Sequence[SpatialBasis], rest: Sequence[np.ndarray]) -> SpatialBasis:
    """The modes of several bodies as those of one: each is zero on the others.

    Args:
        rest: (N, 3) where each body's particles are in frame 0 [m]. Lengths of the prior count in radii of what they make up together.
    """
    everything = np.concatenate(rest)
    centre = everything.mean(axis=0)
    return SpatialBasis(
        phi=block_diag(*(one.phi for one in bases)),
        gradient=np.stack([block_diag(*(one.gradient[..., axis] for one in bases)) for axis in range(3)], axis=-1),
        degree=np.concatenate([one.degree for one in bases]),
        size=np.concatenate([one.size for one in bases]),
        radius=float(np.linalg.norm(everything - centre, axis=1).max()),
        centre=centre,
    )


def _one_after_the_other(counts: Sequence[int]) -> list[slice]:
    ends = np.cumsum(counts)
    return [slice(int(end) - count, int(end)) for count, end in zip(counts, ends, strict=True)]
