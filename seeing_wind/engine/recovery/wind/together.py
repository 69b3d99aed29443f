"""One wind on several bodies: each feels the wind where it is, and a common prior joins them.

The unknowns are the modes of the wind on each body, as for a single body. Their prior is one mean wind and one Gaussian process over the
places that all bodies pass: the nearer two bodies are, the more each reveals of the air at the other. A leaf that lies along the wind and
hardly feels it therefore gets its wind from a neighbour, and the field between two bodies follows from both.
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
    """The forces on several bodies in the same frames, combined like one `Felt`: data and modes are concatenated in order."""

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
        """(D,) root mean square acceleration of each datum's body [m/s²]: the error of the drag law scales with each body's own."""
        return np.concatenate([one.size for one in self.parts])

    @property
    def modes(self) -> int:
        return sum(one.modes for one in self.parts)

    @property
    def uniform_modes(self) -> list[int]:
        """The index of each body's first mode, which is uniform over it."""
        return [rows.start for rows in _one_after_the_other([one.modes for one in self.parts])]

    def uniform(self) -> np.ndarray:
        """(T, 3) a first guess of the wind [m/s]: the mean of the bodies' first guesses."""
        first: np.ndarray = np.mean([one.uniform() for one in self.parts], axis=0)
        return first

    def predicted(self, wind: np.ndarray) -> np.ndarray:
        return np.concatenate([one.predicted(wind[:, rows]) for one, rows in self._with_modes()], axis=1)

    def slopes(self, wind: np.ndarray) -> np.ndarray:
        """(T, D, P, 3) [1/s], as in `Felt`; zero between the data of a body and the modes of another."""
        slopes = np.zeros((*self.measured.shape, self.modes, 3))
        data = _one_after_the_other([one.measured.shape[1] for one in self.parts])
        for (one, rows), own in zip(self._with_modes(), data, strict=True):
            slopes[:, own, rows] = one.slopes(wind[:, rows])
        return slopes

    def _with_modes(self) -> list[tuple[Felt, slice]]:
        return list(zip(self.parts, _one_after_the_other([one.modes for one in self.parts]), strict=True))


def basis_together(bases: Sequence[SpatialBasis], rest: Sequence[np.ndarray]) -> SpatialBasis:
    """The modes of several bodies as those of one: the modes of each are zero on the others.

    Args:
        rest: for each body, (N, 3) positions of its particles in frame 0 [m]. Lengths of the prior are in units of the radius of all
            particles together.
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
