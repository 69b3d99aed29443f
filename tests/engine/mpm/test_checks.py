"""What a simulation refuses, and whom it names when it breaks."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest
import torch

from seeing_wind.engine.errors import MaterialError, SeeingWindError, SimulationError, UsageError
from seeing_wind.engine.mpm.autograd import simulate
from seeing_wind.engine.mpm.batch import rollout_batch
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.mpm.tangent import Changes, tangents
from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Particles
from tests.engine.mpm.bodies import RUBBER, block

BODY = block()
COUNT = len(BODY.x)
CLAY = replace(RUBBER, law="viscoplastic", yield_stress=10.0, viscosity=1.0)


def with_value(array, index, value):
    changed = np.array(array)
    changed[index] = value
    return changed


# -- the model --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change, error, match",
    [
        ({"x": with_value(BODY.x, (3, 1), np.nan)}, SimulationError, "position of particle 3 is not finite"),
        ({"x": BODY.x[:, :2]}, UsageError, r"positions \(60, 2\)"),
        ({"volume": with_value(BODY.volume, 2, np.nan)}, UsageError, "volume of particle 2 is nan"),
        ({"volume": 0.0 * BODY.volume}, UsageError, "volume of particle 0 is 0"),
        ({"volume": BODY.volume[1:]}, UsageError, r"volumes \(59,\)"),
        ({"pinned": BODY.pinned[1:]}, UsageError, r"pins \(59,\)"),
        ({"spacing": 0.0}, UsageError, "spacing of the particles is 0"),
        ({"spacing": -0.01}, UsageError, "spacing of the particles is -0.01"),
    ],
)
def test_bodies_that_are_none_are_refused(change, error, match):
    with pytest.raises(error, match=match) as caught:
        model_for(replace(BODY, **change), RUBBER, 30.0)
    assert caught.value.hint
    pinned = replace(BODY, pinned=BODY.x[:, 2] < 0.01)  # the clamp must not see it first
    with pytest.raises(error):
        model_for(replace(pinned, **change), RUBBER, 30.0)


@pytest.mark.parametrize(
    "change, match",
    [
        ({"youngs_modulus": 0.0}, "Young's modulus of rubber is 0"),
        ({"youngs_modulus": -1e4}, "Young's modulus"),
        ({"youngs_modulus": np.inf}, "not finite"),
        ({"poisson_ratio": 0.5}, "Poisson's ratio of rubber is 0.5"),
        ({"poisson_ratio": -1.0}, "Poisson's ratio"),
        ({"density": 0.0}, "density"),
        ({"density": -300.0}, "density"),
        ({"law": "von_mises", "yield_stress": np.nan}, "not finite"),
        ({"law": "von_mises", "yield_stress": -5.0}, "yield stress of rubber is -5 Pa"),
        ({"law": "viscoplastic", "yield_stress": 5.0, "viscosity": -1.0}, "viscosity"),
    ],
)
def test_materials_that_are_not_physical_are_refused(change, match):
    with pytest.raises(MaterialError, match=match) as caught:
        model_for(BODY, replace(RUBBER, **change), 30.0)
    assert caught.value.hint


@pytest.mark.parametrize(
    "options, match",
    [
        ({"fps": 0.0}, "frames per second is 0"),
        ({"fps": -30.0}, "frames per second is -30"),
        ({"fps": np.nan}, "frames per second is nan"),
        ({"dx": 0.0}, "grid spacing"),
        ({"dx": -0.01}, "grid spacing"),
        ({"gravity": (0.0, 0.0)}, "Gravity"),
        ({"gravity": (0.0, 0.0, np.nan)}, "Gravity"),
        ({"speed": np.nan}, "speed"),
        ({"speed": -1.0}, "speed"),
        ({"max_substeps": 0}, "0 substeps"),
        ({"mass_scale": 0.0}, "mass scale is 0"),
        ({"mass_scale": [1.0, 1.0]}, "Mass scales are given for 2 bodies of 1"),
        ({"clamp_depth": np.inf}, "clamp's depth"),
    ],
)
def test_choices_out_of_range_are_refused(options, match):
    with pytest.raises(UsageError, match=match) as caught:
        model_for(BODY, RUBBER, **({"fps": 30.0} | options))
    assert caught.value.hint


@pytest.mark.parametrize("materials", [[RUBBER], [RUBBER] * 3])
def test_every_body_needs_a_material(materials):
    with pytest.raises(UsageError, match=f"Materials are given for {len(materials)} bodies of 2"):
        model_for([BODY, replace(BODY, x=BODY.x + 0.2)], materials, 30.0)


def test_bodies_too_far_apart_for_one_grid_are_refused():
    with pytest.raises(SimulationError, match="nodes of a grid") as caught:
        model_for([BODY, replace(BODY, x=BODY.x + 1e5)], RUBBER, 30.0)
    assert "apart" in caught.value.hint


def test_pins_that_outrun_the_grid_take_more_substeps_or_are_refused():
    body = block(pinned_below=0.015)
    start = body.x[body.pinned]

    def path(step):
        return np.stack([start + t * np.array([step, 0.0, 0.0]) for t in range(3)])

    slow, _ = model_for(body, replace(RUBBER, youngs_modulus=1e3), 30.0, pin_path=path(0.01))
    fast, _ = model_for(body, replace(RUBBER, youngs_modulus=1e3), 30.0, pin_path=path(100.5 * slow.dx))
    assert slow.substeps < 101 == fast.substeps  # a cell per substep
    with pytest.raises(SimulationError, match="A pinned particle at 3000 m/s"):
        model_for(body, RUBBER, 30.0, pin_path=path(100.0))


# -- shapes: the kernels do not look at an array's length --------------------------------------------------------------------------


@pytest.mark.parametrize("body", [BODY, block((21, 21, 19))], ids=["small", "large"])
def test_arrays_that_do_not_fit_the_model_are_refused(body):
    model, _ = model_for(body, RUBBER, 30.0)
    n, rest = model.particles, State.at_rest(body.x)
    still, slope = np.zeros((2, n, 3)), np.zeros((2, n, 3, 3))
    for acceleration, gradient in (
        (still[:, 1:], None), (still[0], None), (np.zeros((2, n + 1, 3)), None), (still, slope[:, 1:]), (still, slope[:1]), (still, still),
    ):  # fmt: skip
        with pytest.raises(UsageError, match="has shape"):
            rollout(model, rest, acceleration, gradient)
    for change in ({"x": rest.x[1:]}, {"v": rest.v[1:]}, {"C": rest.C[:, :2]}, {"F": np.concatenate([rest.F, rest.F])}):
        with pytest.raises(UsageError, match="has shape"):
            rollout(model, replace(rest, **change), still)
    with pytest.raises(UsageError, match="precision 'half'"):
        rollout(model, rest, still, precision="half")


def test_a_basis_that_does_not_fit_is_refused():
    model, _ = model_for(BODY, RUBBER, 30.0)
    phi, dphi, coefficients = np.ones((COUNT, 2)), np.zeros((COUNT, 2, 3)), np.zeros((1, 1, 2, 3))
    rest = State.at_rest(BODY.x)
    for bad in ((phi[1:], dphi, coefficients), (phi, dphi[:, :1], coefficients), (phi, dphi, np.zeros((1, 1, 1, 3)))):
        with pytest.raises(UsageError, match="basis"):
            rollout_batch(model, rest, *bad)
    with pytest.raises(UsageError, match="state's v"):
        rollout_batch(model, rest, phi, dphi, coefficients, v0=np.zeros((1, COUNT - 1, 3)))


def tensors(**changes):
    inputs = {"x0": BODY.x, "v0": 0.0 * BODY.x, "acceleration": np.zeros((2, COUNT, 3))} | changes
    return {name: torch.tensor(value, dtype=torch.float64) for name, value in inputs.items()}


@pytest.mark.parametrize(
    "changes, error, match",
    [
        ({"acceleration": np.zeros((2, COUNT - 1, 3))}, UsageError, "acceleration has shape"),
        ({"acceleration": np.zeros((COUNT, 3))}, UsageError, "acceleration has shape"),
        ({"gradient": np.zeros((2, COUNT - 1, 3, 3))}, UsageError, "gradient has shape"),
        ({"gradient": np.zeros((1, COUNT, 3, 3))}, UsageError, "gradient has shape"),
        ({"x0": BODY.x[1:]}, UsageError, "state's x"),
        ({"F0": np.zeros((COUNT - 1, 3, 3))}, UsageError, "state's F"),
        ({"youngs_modulus": np.ones(COUNT - 1)}, UsageError, "youngs_modulus has shape"),
        ({"youngs_modulus": -1e4}, MaterialError, "Particle 0 has no stiffness"),
        ({"poisson_ratio": 0.6}, MaterialError, "no stiffness"),
        ({"poisson_ratio": 0.5}, MaterialError, "not finite"),
        ({"density": with_value(np.full(COUNT, 300.0), 9, 0.0)}, MaterialError, "Particle 9 has no mass"),
        ({"yield_stress": -1.0}, MaterialError, "negative yield stress"),
        ({"viscosity": -1.0}, MaterialError, "viscosity"),
        ({"acceleration": with_value(np.zeros((2, COUNT, 3)), (1, 3, 1), np.nan)}, SimulationError, "particle 3 in frame 6"),
    ],
)
def test_the_differentiable_door_refuses_as_much(changes, error, match):
    model, _ = model_for(BODY, CLAY, 30.0)
    with pytest.raises(error, match=match) as caught:
        simulate(model, **tensors(**changes), first_frame=5)
    assert caught.value.hint


# -- who is named -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("body", [BODY, block((21, 21, 19))], ids=["small", "large"])
def test_the_particle_that_broke_it_is_named(body):
    model, _ = model_for(body, RUBBER, 30.0)
    still, rest = np.zeros((2, model.particles, 3)), State.at_rest(body.x)
    for value, where in ((np.nan, "not finite"), (1e9, "more than one grid cell")):
        acceleration = with_value(still, (1, 37, 2), value)
        with pytest.raises(SimulationError, match=where) as caught:
            rollout(model, rest, acceleration, first_frame=4)
        assert caught.value.particle == 37 and caught.value.frame == 5
    inverted = with_value(rest.F, 37, np.diag([-1.0, 1.0, 1.0]))
    with pytest.raises(SimulationError, match="Particle 37 is turned inside out at the start"):
        rollout(model, replace(rest, F=inverted), still)
    with pytest.raises(SimulationError, match="Particle 37 starts too far"):
        rollout(model, replace(rest, x=with_value(rest.x, 37, 1e12)), still)


@pytest.mark.parametrize("how", ["alone", "as a copy"])
def test_the_particle_that_flew_off_is_named(monkeypatch, how):
    body = block((3, 3, 3))
    lost = Particles(np.full((1, 3), 0.3), body.volume[:1], np.zeros(1, bool), body.spacing)
    model, _ = model_for([lost, body], RUBBER, 30.0, gravity=(0, 0, 0))
    for module in ("substeps", "copies_run"):
        monkeypatch.setattr(importlib.import_module(f"seeing_wind.engine.mpm.body.{module}"), "MOST_NODES", 40_000)
    x, v = np.concatenate([lost.x, body.x]), np.zeros((model.particles, 3))
    v[0] = 6.0
    with pytest.raises(SimulationError, match="flew off") as caught:
        if how == "alone":
            rollout(model, State.at_rest(x, v), np.zeros((5, model.particles, 3)))
        else:
            phi = np.ones((model.particles, 1))
            rollout_batch(model, State.at_rest(x, v), phi, 0.0 * x[:, None], np.zeros((2, 5, 1, 3)), strict=True)
    assert caught.value.particle == 0 and caught.value.quantity == "position" and caught.value.frame > 0


def test_bodies_in_a_row_longer_than_a_grid_can_be_are_refused():
    far = replace(BODY, x=BODY.x + np.array([0.0, 0.0, 8300 * 2.0 * BODY.spacing]))
    with pytest.raises(SimulationError, match="or 8191 in a row"):
        model_for([BODY, far], RUBBER, 30.0)


def test_changes_carried_along_name_the_particle_too():
    model, _ = model_for(BODY, RUBBER, 30.0)
    phi, dphi = np.zeros((COUNT, 1)), np.zeros((COUNT, 1, 3))
    phi[37] = 1.0
    coefficients = np.zeros((2, 1, 3))
    coefficients[1, 0, 2] = 1e9
    with pytest.raises(SimulationError, match="more than one grid cell") as caught:
        tangents(model, State.at_rest(BODY.x), phi, dphi, coefficients, Changes(np.zeros((8, 2, 1, 3))), NoProgress())
    assert caught.value.particle == 37 and caught.value.frame == 1
    with pytest.raises(SeeingWindError, match="state's x"):
        tangents(model, State.at_rest(BODY.x[1:]), phi, dphi, coefficients, Changes(np.zeros((8, 2, 1, 3))), NoProgress())
