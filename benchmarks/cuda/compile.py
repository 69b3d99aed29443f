"""Compiles the solver's kernels for CUDA on a machine without a GPU: benchmarks/cuda/compile.py [--laws LAW ...] [--forward]

Taichi compiles to PTX by itself and needs the driver only to load and launch it. `no_driver.c` stands in for the driver: it writes each
module's PTX to a file and launches nothing. Every module is then assembled by `ptxas` for sm_80, if there is one (it comes with the CUDA
toolkit). What this shows: the sources trace, compile and assemble for CUDA. What it does not: that they compute the right thing there,
or how fast.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ARCHITECTURE = "sm_80"
LAWS = ("corotated", "neo_hookean", "von_mises", "viscoplastic")


def launch_all(laws: list[str], forward_only: bool) -> None:
    """Goes through the solver as a simulation on CUDA would; with `no_driver.c` every launch does nothing."""
    sys.path.insert(0, str(ROOT))
    import numpy as np

    from seeing_wind.engine.conventions import GRAVITY
    from seeing_wind.engine.mpm import State, model_for
    from seeing_wind.engine.mpm.body import Body
    from seeing_wind.engine.mpm.kernels.native import aligned_zeros
    from seeing_wind.engine.progress import NoProgress
    from seeing_wind.engine.records import Material, Particles

    np.empty = np.zeros  # a kernel that does not run leaves its result as it was: zeros are positions, what lay there before may not be
    x = 0.01 * np.stack(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    particles = Particles(x, np.full(len(x), 1e-6), np.zeros(len(x), bool), 0.01)
    for law in laws:
        material = Material(law, law, density=300.0, youngs_modulus=2e4, poisson_ratio=0.3, yield_stress=300.0, viscosity=2.0)
        model, _ = model_for(particles, material, 30.0, device="cuda")
        model = replace(model, substeps=2)
        for precision in ("single", "double"):
            body, state = Body(model, precision), State.at_rest(x)
            assert body.gpu, "Taichi did not start on CUDA"
            _, run = body.frame(body.checked(state), np.tile(GRAVITY, (len(x), 1)), None, 0, NoProgress())
            if not forward_only:
                body.pull_back(run, aligned_zeros((6 * len(x), 4), body.real), True, NoProgress())


def compiled(laws: list[str], forward_only: bool, folder: Path) -> list[Path]:
    """The PTX files of all kernels for those laws, written to `folder`.

    Raises:
        subprocess.CalledProcessError: the C compiler or a kernel failed.
    """
    subprocess.run(["cc", "-w", "-shared", "-fPIC", "-o", folder / "libcuda.so", HERE / "no_driver.c"], check=True)
    environment = os.environ | {"LD_LIBRARY_PATH": str(folder), "PTX_FOLDER": str(folder), "TI_OFFLINE_CACHE": "0"}
    options = ["--launch", "--laws", *laws, *(["--forward"] if forward_only else [])]
    subprocess.run([sys.executable, "-W", "ignore::RuntimeWarning", __file__, *options], env=environment, check=True)
    return sorted(folder.glob("module_*.ptx"))


def kernels(modules: list[Path]) -> set[str]:
    """Names of the kernels in PTX files, without those of Taichi's own runtime."""
    entries = {name for module in modules for name in re.findall(r"\.visible \.entry (\w+?)_c\d+_", module.read_text())}
    return {name for name in entries if not name.startswith("runtime_")}


def assemble(modules: list[Path]) -> bool:
    """Runs ptxas over PTX files; False where there is none.

    Raises:
        subprocess.CalledProcessError: it refused one.
    """
    ptxas = shutil.which("ptxas")
    if ptxas is None:
        return False
    for module in modules:
        subprocess.run([ptxas, f"-arch={ARCHITECTURE}", "-o", os.devnull, module], check=True)
    return True


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--laws", nargs="+", default=list(LAWS), choices=LAWS)
    parser.add_argument("--forward", action="store_true", help="leave the adjoint out")
    parser.add_argument("--launch", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.launch:
        launch_all(options.laws, options.forward)
        return
    with tempfile.TemporaryDirectory() as folder:
        modules = compiled(options.laws, options.forward, Path(folder))
        print(f"{len(modules)} modules with the kernels {', '.join(sorted(kernels(modules)))}")
        print(f"assembled for {ARCHITECTURE}" if assemble(modules) else "ptxas is not installed: not assembled")


if __name__ == "__main__":
    main()
