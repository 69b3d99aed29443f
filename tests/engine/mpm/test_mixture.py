"""Bodies whose parts have materials of their own, against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from seeing_wind.engine.conventions import lame
from seeing_wind.engine.errors import UsageError
from seeing_wind.engine.materials import Material
from seeing_wind.engine.mpm.courant import substeps_of
from seeing_wind.engine.mpm.model_for import model_for
from seeing_wind.engine.mpm.rollout import rollout
from seeing_wind.engine.mpm.state import State
from seeing_wind.engine.records import Mixture, Particles
from tests.engine.mpm.bodies import RUBBER, block
from tests.engine.mpm.test_physics import bar, oscillation


def mixed(body: Particles, part: np.ndarray, material: Material, density=1.0, stiffness=1.0, nu=None, retardation=None) -> Particles:
    """The body with other factors on density and Young's modulus, and another Poisson's ratio and retardation [s], in `part` (N,) bool."""
    return replace(body, mixture=Mixture(
        np.where(part, density, 1.0), np.where(part, stiffness, 1.0),
        np.where(part, material.poisson_ratio if nu is None else nu, material.poisson_ratio),
        np.where(part, material.retardation if retardation is None else retardation, material.retardation),
    ))  # fmt: skip


def swing(body: Particles, beam: Material, omega: float) -> float:
    """Circular frequency [rad/s] with which a clamped bar swings after a small push."""
    fps, length = 16 * omega / (2 * np.pi), np.ptp(body.x[:, 2])
    model, notes = model_for(body, beam, fps, gravity=(0, 0, 0), max_substeps=2000, speed=0.01)
    assert not notes
    push = np.broadcast_to([1e-3 * length * omega**2, 0.0, 0.0], (24, model.particles, 3))
    path = rollout(model, State.at_rest(body.x), push)
    tip = (path.x - path.x[0])[:, np.isclose(body.x[:, 2], body.x[:, 2].max()), 0].mean(axis=1)
    return float(oscillation(np.arange(25) / fps, tip, omega)[1])


@pytest.mark.parametrize("heavier", [0.2, 12.0])
def test_a_cantilever_with_a_tip_of_another_density_swings_at_the_frequency_of_a_beam_with_a_tip_mass(heavier: float) -> None:
    """Euler-Bernoulli: 1 + cos b cosh b + a b (cos b sinh b - sin b cosh b) = 0, a the tip's mass over the beam's, omega ~ b²."""
    thick, along, tip_rows, rows, spacing, E, density = 0.06, 18, 3, 2, 0.02, 1e5, 500.0
    beam, body = Material("beam", "neo_hookean", density, E, 0.3), bar(3, along + rows, spacing, rows)
    length = (along - 0.5 * tip_rows) * spacing  # to the middle of the tip
    ratio = (heavier * tip_rows - 0.5 * tip_rows) * spacing / length  # what the tip has beyond a beam of this length

    def root(a: float) -> float:
        b = np.linspace(0.5, 3.0, 500)
        value = 1 + np.cos(b) * np.cosh(b) + a * b * (np.cos(b) * np.sinh(b) - np.sin(b) * np.cosh(b))
        first = int(np.flatnonzero(np.diff(np.sign(value)))[0])
        return float(brentq(
            lambda b: 1 + np.cos(b) * np.cosh(b) + a * b * (np.cos(b) * np.sinh(b) - np.sin(b) * np.cosh(b)), b[first], b[first + 1]
        ))  # fmt: skip

    unit = np.sqrt(E * thick**2 / (12.0 * density))
    plain, tipped = (1.8751 / (along * spacing)) ** 2 * unit, (root(ratio) / length) ** 2 * unit
    tip = body.x[:, 2] > body.x[:, 2].max() - (tip_rows - 0.5) * spacing
    found = swing(mixed(body, tip, beam, heavier), beam, tipped)
    # In units of the same body of one density, so that the grid's error of the stiffness cancels.
    assert found / swing(body, beam, plain) == pytest.approx(tipped / plain, rel=0.03)
    assert abs(tipped / plain - 1.0) > 0.2


def test_a_uniform_force_density_moves_a_free_body_of_two_densities_by_force_over_mass() -> None:
    body = block((4, 4, 6), jitter=0.0)
    body = mixed(body, body.x[:, 2] > 0.025, RUBBER, density=0.25)
    force, frames, fps = np.array([30.0, 0.0, -12.0]), 10, 30.0
    model, _ = model_for(body, RUBBER, fps, gravity=(0, 0, 0))
    whole = RUBBER.density * (0.5 + 0.5 * 0.25) * body.volume.sum()
    assert body.mass(RUBBER) == pytest.approx(whole) and model.mass.sum() == pytest.approx(whole)
    path = rollout(model, State.at_rest(body.x), np.broadcast_to(force / body.density(RUBBER)[:, None], (frames, model.particles, 3)))
    velocity = (model.mass[:, None] * path.v[-1]).sum(axis=0) / whole
    np.testing.assert_allclose(velocity, force * body.volume.sum() / whole * frames / fps, rtol=1e-6, atol=1e-9)


def test_each_part_has_its_own_numbers_and_the_fastest_waves_set_the_substeps() -> None:
    body = block(pinned_below=0.005)
    part, damped = body.x[:, 2] > 0.02, replace(RUBBER, loss_factor=0.001)
    own = mixed(body, part, damped, density=0.5, stiffness=9.0, nu=0.1, retardation=1e-5)
    model, notes = model_for(own, damped, 30.0, gravity=(0, 0, 0))
    assert not notes
    mu, lam = lame(9.0 * 2e4, 0.1)
    np.testing.assert_allclose(model.mu[part], mu)
    np.testing.assert_allclose(model.lam[part], lam)
    np.testing.assert_allclose(model.mass / model.volume, np.where(part, 150.0, 300.0))
    np.testing.assert_allclose(model.viscosity / model.mu, np.where(part, 1e-5, damped.retardation), rtol=1e-6)
    alone = Material("part", "corotated", 150.0, 9.0 * 2e4, 0.1)
    assert substeps_of(own, damped, 30.0) == substeps_of(body, alone, 30.0) > substeps_of(body, damped, 30.0)
    path = rollout(model, State.at_rest(own.x), np.full((30, model.particles, 3), 0.5))
    assert np.abs(path.x - own.x).max() < 0.01, "stable"


def test_a_mixture_that_does_not_fit_its_body_is_refused() -> None:
    body = block()
    short = mixed(block((2, 2, 2)), np.zeros(8, bool), RUBBER).mixture
    with pytest.raises(UsageError, match=r"60 particles.*density of 8"):
        model_for(replace(body, mixture=short), RUBBER, 30.0)
    with pytest.raises(UsageError, match="density of a particle is out of range"):
        model_for(mixed(body, body.x[:, 2] > 0.02, RUBBER, density=-1.0), RUBBER, 30.0)
