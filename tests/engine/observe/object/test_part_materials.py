"""Head and leaves of a body on a stem with materials of their own."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np
import pytest

from seeing_wind.engine.conventions import front_view
from seeing_wind.engine.errors import MaterialError
from seeing_wind.engine.materials import LIMITS, find
from seeing_wind.engine.mpm.courant import wave_substeps
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.observe.object.body import Rest, rest_body
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.record_arrays import from_arrays, to_arrays
from seeing_wind.engine.records import Body, Camera, Observation
from seeing_wind.engine.settings import BuildSettings
from seeing_wind.engine.settings.build import part_materials
from seeing_wind.engine.stages import build_stage
from seeing_wind.engine.take import Take
from tests.engine.observations import observed

HALF, HEAD, PIXELS = 4.5, 26.0, 1200.0
"""Half the stem's thickness and the head's radius [px]; pixels per metre."""
STEM = BuildSettings(material="plant_stem", youngs_modulus=3e4)


def flower(leaf: bool = True) -> Observation:
    """A flower of a stem, a round head and a leaf, held at the foot of its stem; no depth is measured."""
    rows, columns = np.mgrid[:180, :120]
    stem = (np.abs(columns - 60) < HALF) & (rows > 40)
    beside = (np.abs(rows - 110) <= 5) & (columns > 60) & (columns < 108) & leaf
    mask = stem | beside | (np.hypot(columns - 60, rows - 40) < HEAD)
    camera = Camera(120, 180, PIXELS, PIXELS, 59.5, 89.5, front_view(1.0))
    return observed(mask, 1.0, camera=camera, pin=stem & (rows >= 165))


def body(seen: Observation, **settings) -> Rest:
    found = rest_body(seen, dataclasses.replace(STEM, **settings))
    assert found is not None and found.relief.kind == "parts"
    return found


def places(seen: Observation, found: Rest) -> tuple[np.ndarray, np.ndarray]:
    """Which particles are in the head, and which in the leaf, by their places in the frame."""
    x, y = seen.camera.project(found.particles.x)[0].T
    return y < 40 + HEAD - 4, (x > 70) & (y > 90)


def test_each_part_has_the_numbers_of_its_own_material_and_the_rest_stays_in_place() -> None:
    seen = flower()
    plain, own = body(seen), body(seen, head_material="flower_head", leaf_material="jelly")
    for name in ("x", "volume", "pinned"):
        np.testing.assert_array_equal(getattr(own.particles, name), getattr(plain.particles, name))
    assert plain.particles.mixture is None
    head, leaf = places(seen, own)
    assert head.sum() > 5 and leaf.sum() > 5
    density = own.particles.density(own.material)
    for part, name in ((head, "flower_head"), (leaf, "jelly"), (own.particles.pinned, "plant_stem")):
        stuff = find(name)
        np.testing.assert_allclose(density[part], stuff.density)
        np.testing.assert_allclose(own.particles.mixture.poisson_ratio[part], stuff.poisson_ratio)
        np.testing.assert_allclose(own.particles.mixture.retardation[part], stuff.retardation)
    np.testing.assert_allclose(own.particles.mixture.youngs_modulus[head], 1e5 / 3e4)
    lighter = 1.0 - own.particles.mass(own.material) / plain.particles.mass(plain.material)
    assert lighter == pytest.approx(1.0 - (own.particles.volume * density).sum() / (900.0 * own.particles.volume.sum())) and lighter > 0.5


def test_a_head_without_a_material_of_its_own_is_as_the_stem() -> None:
    only = body(flower(), leaf_material="jelly")
    head, _ = places(flower(), only)
    only = only.particles.mixture
    assert (only.density[head] == 1.0).all() and (only.youngs_modulus[head] == 1.0).all()


def test_stiff_leaves_widen_the_rods_and_a_stiff_head_is_softened_to_what_the_substeps_carry() -> None:
    def wider(**settings) -> float:
        found = body(flower(), **settings).particles
        return 1.0 if found.stiffness is None else float(found.stiffness[0]) ** -0.5

    assert wider() == 1.0
    assert wider(leaf_material="leaf") > 1.2 and wider(leaf_material="jelly") == 1.0
    stiff = body(flower(), head_material="wood")
    head, _ = places(flower(), stiff)
    assert stiff.particles.stiffness is not None and (stiff.particles.stiffness[head] < 0.1).all()
    assert (stiff.particles.stiffness[~head & stiff.particles.pinned] == 1.0).all(), "the stem stays as it is"
    dx = LIMITS.cell_spacings * stiff.particles.spacing
    assert wave_substeps((stiff.particles, stiff.material, 1.0), dx, 1.0 / 30.0) <= LIMITS.max_substeps + 1
    assert len(model_for(stiff.particles, stiff.material, 30.0)[1]) == 1, "of damping, not of a softened body"


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"head_material": "unobtainium"}, "There is no material 'unobtainium'"),
        ({"head_material": "clay"}, "--head-material clay cannot be used: clay has the plastic law"),
        ({"leaf_material": "leaf", "law": "von_mises", "yield_stress": 1e4}, "--leaf-material leaf cannot be used: plant_stem has"),
    ],
)
def test_what_cannot_be_a_part_is_refused(settings, says: str) -> None:
    with pytest.raises(MaterialError, match=says):
        part_materials(dataclasses.replace(STEM, **settings))


def test_materials_of_parts_that_are_not_there_are_said_to_have_no_effect() -> None:
    seen = flower(leaf=False)
    assert body(flower(), head_material="foam", leaf_material="leaf").told == ()
    assert body(seen, leaf_material="leaf").told == ("--leaf-material had no effect: no leaf was found beside the stem.",)
    free = rest_body(dataclasses.replace(seen, pin=np.zeros_like(seen.pin)), dataclasses.replace(STEM, head_material="foam"))
    assert free is not None and free.particles.mixture is None
    assert len(free.told) == 1 and free.told[0].startswith("--head-material had no effect: no stem was found")


def test_a_head_that_its_stem_cannot_bear_is_told_with_the_load_at_which_a_column_buckles() -> None:
    E, radius, length = 4e6, HALF / PIXELS, (165 - 40) / PIXELS  # from the held foot to the head's centre
    found = body(flower(), youngs_modulus=E)
    mass = 900.0 * 4.0 / 3.0 * math.pi * (HEAD / PIXELS) ** 3
    along = 900.0 * found.particles.volume.sum() - mass
    itself = 2.47 / 7.84 * along
    bears = 1e3 * (math.pi**2 * E * (math.pi * radius**4 / 4.0) / (4.0 * length**2) / 9.81 - itself)
    said = re.fullmatch(r"The head weighs (\d+) g, and a stem 7.5 mm thick of 4 MPa bears (\d+) g besides itself: .*", found.top_heavy)
    assert said is not None and "(--head-material)" in found.top_heavy
    assert float(said[1]) == pytest.approx(1e3 * mass, rel=0.1) and float(said[2]) == pytest.approx(bears, rel=0.2)
    assert body(flower(), youngs_modulus=1e9).top_heavy == ""
    assert "does not even bear itself" in body(flower(), youngs_modulus=1e5).top_heavy
    enough = E * (0.5e3 * (mass + along)) / bears  # for more than a quarter of the head, and less than all of it
    assert body(flower(), youngs_modulus=enough).top_heavy
    assert not body(flower(), youngs_modulus=enough, head_material="flower_head").top_heavy


def test_a_body_of_parts_is_kept_in_the_take(tmp_path) -> None:
    settings = dataclasses.replace(STEM, youngs_modulus=1e5, head_material="flower_head", particles=60)
    take = Take(tmp_path / "one.take")
    take.prepare()
    first, stamp = build_stage(take, flower(), "seen", settings, NoProgress())
    again, same = build_stage(take, flower(), "seen", settings, NoProgress())
    assert stamp == same and first.particles.mixture is not None and first.top_heavy
    assert to_arrays(first).keys() == to_arrays(again).keys()
    for name, array in to_arrays(first).items():
        np.testing.assert_array_equal(to_arrays(again)[name], array, err_msg=name)
    assert build_stage(take, flower(), "seen", dataclasses.replace(settings, head_material="foam"), NoProgress())[1] != stamp
    older = {name: array for name, array in to_arrays(first).items() if "mixture" not in name and name not in ("told", "top_heavy")}
    assert from_arrays(Body, older).particles.mixture is None, "a take from before there were parts"
