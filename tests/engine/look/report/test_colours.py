"""The force scale and its colours."""

from __future__ import annotations

import numpy as np
import pytest

from seeing_wind.engine.look.report.colours import force_colours, scale_top


@pytest.mark.parametrize("strength, top", [(0.97, 1.0), (1.0, 1.0), (1.01, 1.2), (83.0, 100.0), (1180.0, 1200.0), (0.0, 1.0)])
def test_the_scale_ends_at_a_round_number(strength, top):
    assert scale_top(np.full(10, strength)) == pytest.approx(top)


def test_a_few_outliers_do_not_stretch_the_scale():
    strength = np.ones(1000)
    strength[:5] = 1e6
    assert scale_top(strength) == 1.0


def test_from_purple_to_red_and_clamped():
    weak, strong = force_colours(np.array([0.0, 1.0]))
    assert weak[2] > weak[0] > weak[1] and strong[0] > 200 > strong[1]
    assert np.array_equal(force_colours(np.array([-3.0, 7.0])), [weak, strong])


def test_it_never_gets_too_dark_to_see():
    luminance = force_colours(np.linspace(0, 1, 200)) @ [0.2126, 0.7152, 0.0722]
    assert luminance.min() > 70
