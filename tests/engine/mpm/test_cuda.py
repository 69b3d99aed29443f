"""The kernels compile for CUDA, also where there is no GPU; the whole set: benchmarks/cuda/compile.py."""

from __future__ import annotations

import shutil
import sys

import pytest

from benchmarks.cuda.compile import assemble, compiled, kernels


@pytest.mark.skipif(not sys.platform.startswith("linux") or shutil.which("cc") is None, reason="needs Linux and a C compiler")
def test_forward_kernels_compile_for_cuda(tmp_path):
    modules = compiled(["corotated"], True, tmp_path)
    assert {"substeps", "pack", "pack_forces", "unpack"} <= kernels(modules)
    assemble(modules)
