"""torch's optimisers without its compiler."""

from __future__ import annotations

import inspect
import sys

import pytest
import torch

from seeing_wind.engine.field import optimisers


def descended(kind: type[torch.optim.Optimizer], **options: float) -> torch.Tensor:
    """Where five steps down a curved valley end."""
    a, b = (torch.tensor(start, dtype=torch.float64, requires_grad=True) for start in ([1.5, -0.5], [2.0]))
    optimiser = kind([{"params": [a, b]}], **options)

    def loss() -> torch.Tensor:
        optimiser.zero_grad()
        value = ((1.0 - a) ** 2).sum() + 10.0 * (b - a[0] * a[1]).square().sum()
        value.backward()
        return value

    for _ in range(5):
        optimiser.step(loss)
    assert a.requires_grad and a.grad is not None
    return torch.cat([a, b]).detach()


@pytest.mark.parametrize(("name", "options"), [("Adam", {"lr": 0.1}), ("LBFGS", {"lr": 0.5})])
def test_they_descend_as_torchs_own_to_the_last_bit_and_do_not_load_it(name: str, options: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = descended(getattr(torch.optim, name), **options)
    for wrapped in (torch.optim.Optimizer.add_param_group, torch.optim.Optimizer.zero_grad):
        monkeypatch.delattr(inspect.unwrap(wrapped), "__dynamo_disable", raising=False)  # torch's own remember what they have loaded
    monkeypatch.setitem(sys.modules, "torch._dynamo", None)  # an import of it is an error now
    assert torch.equal(descended(getattr(optimisers, name), **options), wanted)
    assert wanted.abs().sum() > 1.0
