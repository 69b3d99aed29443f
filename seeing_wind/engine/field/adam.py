"""Adam's state as arrays, so that a descent can be resumed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
import torch
from torch.optim import Adam
from torch.optim.lr_scheduler import LRScheduler

MOMENTS = ("step", "exp_avg", "exp_avg_sq")
RANDOM = "random"


def adam_state(optimiser: Adam) -> dict[str, np.ndarray]:
    """Parameters, moments and the state of torch's random numbers."""
    arrays = {RANDOM: torch.get_rng_state().numpy()}
    for number, parameter in enumerate(_parameters(optimiser)):
        arrays[f"{number}"] = parameter.detach().numpy()
        arrays |= {f"{number}.{name}": value.numpy() for name, value in optimiser.state.get(parameter, {}).items() if name in MOMENTS}
    return arrays


def restore(optimiser: Adam, schedule: LRScheduler, arrays: dict[str, np.ndarray], iterations: int) -> None:
    """Bring a new optimiser, and its schedule of learning rates, to the state that `adam_state` returned after so many iterations."""
    optimiser.zero_grad()
    for _ in range(iterations):  # without gradients this changes the rates only
        optimiser.step()
        schedule.step()
    with torch.no_grad():
        for number, parameter in enumerate(_parameters(optimiser)):
            parameter.copy_(torch.from_numpy(arrays[f"{number}"]))
            moments = {name: torch.from_numpy(arrays[f"{number}.{name}"]) for name in MOMENTS if f"{number}.{name}" in arrays}
            if moments:
                optimiser.state[parameter] = moments
    torch.set_rng_state(torch.from_numpy(arrays[RANDOM]))


def in_parts(values: np.ndarray, parameters: Iterable[torch.Tensor]) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
    """Each parameter with its part of `values` (P,), which has the values of all parameters one after another."""
    listed = list(parameters)
    for parameter, part in zip(listed, torch.from_numpy(values).split([one.numel() for one in listed]), strict=True):
        yield parameter, part.view_as(parameter)


def _parameters(optimiser: Adam) -> list[torch.Tensor]:
    return [parameter for group in optimiser.param_groups for parameter in group["params"]]
