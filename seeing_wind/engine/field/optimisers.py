"""torch's optimisers without its compiler, which they import on their first call: a second of every recovery, and nothing here is compiled.

What they wrap tells that compiler to keep out; the arithmetic is theirs, to the last bit.
"""

from __future__ import annotations

import inspect
from typing import Any

import torch
from torch.optim import Optimizer

_add_param_group: Any = inspect.unwrap(Optimizer.add_param_group)
_zero_grad: Any = inspect.unwrap(Optimizer.zero_grad)


class Adam(torch.optim.Adam):
    """`torch.optim.Adam`."""

    add_param_group = _add_param_group
    zero_grad = _zero_grad
    step: Any = torch.no_grad()(inspect.unwrap(torch.optim.Adam.step))


class LBFGS(torch.optim.LBFGS):
    """`torch.optim.LBFGS`, whose step is not wrapped."""

    add_param_group = _add_param_group
    zero_grad = _zero_grad
