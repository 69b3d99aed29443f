"""A force on a held body whose parts have densities of their own: the force density is smooth, not the acceleration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from seeing_wind.engine.progress import NoProgress
from seeing_wind.engine.records import Mixture
from seeing_wind.engine.recovery.recover import recover
from tests.engine.recovery.bodies import FPS, RUBBER, WEIGHTLESS, blow, plate, points, relative

STUFF = replace(RUBBER, youngs_modulus=4e4)
LIGHT = 0.25


def body():
    """A post, held at its foot, whose upper third has a quarter of the density."""
    post = plate((2, 2, 12), pinned=lambda X: X[:, 2] < -0.08)
    head, count = post.x[:, 2] > 0.04, len(post.x)
    mixture = Mixture(np.where(head, LIGHT, 1.0), np.ones(count), np.full(count, STUFF.poisson_ratio), np.zeros(count))
    return replace(post, mixture=mixture)


def force(X, t):
    """[N/m³], smooth over the body."""
    height = (X[:, 2:] + 0.11) / 0.22
    return STUFF.density * (1.5 * np.sin(0.5 * t + height) * [1.0, 0.0, 0.0] + 0.5 * np.cos(0.3 * t) * height * [0.0, 1.0, 0.0])


def test_the_force_on_a_body_of_two_densities_comes_back_if_they_are_known():
    post = body()
    x, _ = blow(post, lambda X, t: force(X, t) / post.density(STUFF)[:, None], 20, material=STUFF)
    true = np.stack([force(post.x, t) for t in range(20)])
    settings = replace(WEIGHTLESS, stiffness="given", iterations=4)
    free = ~post.pinned
    across = (slice(None), free, slice(0, 2))
    found, alike = (recover(one, STUFF, points(one, x), FPS, settings, NoProgress()) for one in (post, replace(post, mixture=None)))
    errors = [relative(one.force_density[across], true[across]) for one in (found, alike)]
    assert errors[0] < 0.2 and errors[1] > 4.0 * errors[0]
    error = np.sqrt(((found.force_density - true)[across] ** 2).mean())
    assert 0.3 < error / np.sqrt((found.deviation[across] ** 2).mean()) < 2.0, "the deviation is that of the force density, too"
