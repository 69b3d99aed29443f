"""The arrows of a wind from the library. The wind comes with its values, from which the arrows are made once it is in a scene."""

from __future__ import annotations

import bpy
import numpy as np

from ...scene_units import metres_per_unit
from ..arrows import create_arrows
from ..conform import set_stride
from ..display import ARROWS, WIND, WITH_FIELD, home_of, stride_of
from ..lattice import lattice
from ..samples import read_samples, samples_of

ALONG = 7
"""Arrows along the longest side of a wind's box."""


def show_arrows(scene: bpy.types.Scene, field: bpy.types.Object) -> None:
    """Give a field object with a wind, whose values are its own, arrows that follow it. They are not rendered.

    All are drawn with full confidence: the recovered one is that along the flight of one plate, while solvers feel the wind everywhere.

    Args:
        scene: the scene that contains the field.
    """
    samples = samples_of(field)
    if samples is None:
        return
    known, place, unit = read_samples(samples), np.array(field.matrix_basis), metres_per_unit(scene)
    values, nodes = known.felt_as(WIND), lattice(known.box, ALONG)
    arrows = create_arrows(
        scene, f"{field.name} Arrows", (nodes @ place[:3, :3].T + place[:3, 3]) * unit, values.at(nodes) @ place[:3, :3].T * unit,
        frame_start=int(field["seeing_wind_frame_start"]), parent=field, collection=home_of(field, scene), units="m/s",
        distance=None if known.distance is None else known.distance_at(nodes) * unit,
    )  # fmt: skip
    arrows.hide_render, arrows[ARROWS], samples[WITH_FIELD] = True, True, True
    field[ARROWS] = arrows
    set_stride(field, stride_of(field))
