"""torch's optimisers without torch's compiler, which they import on their first call: it costs every recovery a second for nothing.

The wrappers that are removed here only tell that compiler to stay out; the arithmetic is torch's own, to the last bit.
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
