"""How many threads torch takes: one where tensors are small."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def one_torch_thread() -> Iterator[None]:
    """Torch on one thread, inside or, as a decorator, within a function.

    The threads of a pool mostly wait for each other then, on the spot: six times slower on a busy machine, and even on an idle one the
    solver's own threads miss the cores that they wait on. The result does not depend on the number of cores, either.
    """
    with torch_threads(1):
        yield


@contextlib.contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """So many of them inside."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
