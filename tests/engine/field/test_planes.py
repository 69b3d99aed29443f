"""Splines on planes, and the start of the decoder."""

from __future__ import annotations

import pytest
import torch

from seeing_wind.engine.field.representations.planes import Planes, decoder, spline_weights
from seeing_wind.engine.field.representations.triplane import CausalTriPlane


@pytest.mark.parametrize("degree", [1, 2])
def test_splines_sum_to_one_and_reproduce_straight_lines(degree):
    s, nodes = torch.linspace(0, 1, 101, dtype=torch.float64), 7
    index, weight = spline_weights(s, nodes, degree)
    assert index.min() >= 0 and index.max() < nodes
    assert torch.allclose(weight.sum(dim=1), torch.ones_like(s))
    u = s * (nodes - 1) if degree == 1 else 0.5 + s * (nodes - 2)
    assert torch.allclose((weight * index).sum(dim=1), u)


def test_the_quadratic_spline_has_a_continuous_slope_and_the_linear_one_has_not():
    torch.manual_seed(0)
    values, s = torch.randn(9, dtype=torch.float64), torch.linspace(0.05, 0.95, 20001, dtype=torch.float64)
    jump = {}
    for degree in (1, 2):
        index, weight = spline_weights(s, 9, degree)
        slope = (weight * values[index]).sum(dim=1).diff() / (s[1] - s[0])
        jump[degree] = slope.diff().abs().max()
    assert jump[2] < 0.02 * jump[1]


def test_total_variation_is_zero_for_flat_planes_only():
    planes = Planes([(0, 1), (1, 2)], [(4, 5), (5, 6)], 3, 2)
    assert planes.total_variation() > 0
    with torch.no_grad():
        planes.table.fill_(2.5)
    assert planes.total_variation() == 0


def test_products_and_sums_over_planes():
    planes = Planes([(0, 1), (0, 2), (1, 2)], [(4, 4)] * 3, 2, 2, start=3.0, spread=0.0)
    stencil = planes.stencil(torch.rand(10, 3))
    assert torch.allclose(planes.summed(stencil), torch.full((10, 2), 9.0))
    assert torch.allclose(planes.multiplied(stencil), torch.full((10, 2), 27.0))


@pytest.mark.parametrize("how", ["summed", "multiplied"])
def test_derivatives_by_the_table_and_by_the_place_are_those_of_differences(how):
    torch.manual_seed(0)
    planes = Planes([(0, 1), (1, 2)], [(4, 5), (5, 6)], 3, 2).double()
    s = 0.1 + 0.8 * torch.rand(7, 3, dtype=torch.float64)

    def looked_up(table, s):
        return torch.func.functional_call(_Lookup(planes, how), {"planes.table": table}, (s,))

    assert torch.autograd.gradcheck(looked_up, (planes.table.detach().requires_grad_(), s.requires_grad_()))


class _Lookup(torch.nn.Module):
    def __init__(self, planes, how):
        super().__init__()
        self.planes, self.how = planes, how

    def forward(self, s):
        return getattr(self.planes, self.how)(self.planes.stencil(s))


def test_a_new_field_has_no_force():
    module = CausalTriPlane(5, [(6, 6, 6)])
    assert not module(torch.rand(20, 3), torch.randint(5, (20,))).any()
    assert decoder(4, 8, 2)[-1].weight.abs().max() == 0


def test_roughness_starts_flat_in_time():
    space, time = CausalTriPlane(5, [(6, 6, 6)]).roughness()
    assert space > 0 and time == 0
