"""The number of threads that torch uses: one where tensors are small."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch


@contextlib.contextmanager
def one_torch_thread() -> Iterator[None]:
    """Torch on one thread within a block or, as a decorator, within a function.

    With small tensors the threads of a pool mostly spin while they wait for each other: six times slower on a busy machine, and even on an
    idle one they take cores that the solver's own threads need. With one thread the result does not depend on the number of cores, either.
    """
    with torch_threads(1):
        yield


@contextlib.contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Torch on `count` threads within a block."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
