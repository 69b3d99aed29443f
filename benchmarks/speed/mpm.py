"""The solver against others, in one run: `make benchmark-mpm`, or benchmarks/speed/mpm.py [--particles N] [--repeats N] [--skip NAME ...]

The same body, particles, grid, substep and law for: this solver, forwards and backwards; a straightforward Taichi MLS-MPM; NVIDIA Warp on
the CPU; torch. All in single precision. First all must reach the same state; then they take turns. A ratio is the median over the turns
of the ratio within each, so that a machine that is slower for a while is so for both sides. What is timed forwards are substeps, of all of
them: nobody's loading and unloading of particles counts. What a whole frame of this solver costs, with that, is printed beside it.
Writes benchmarks/results/mpm.json and mpm.png, and docs/mpm_cost.png (cost against particles).
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
import time
from pathlib import Path

import numpy as np
import torch

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.speed.peers.ours import model_of, seconds, state_of  # noqa: E402
from benchmarks.speed.peers.problem import LAWS, Problem, cube  # noqa: E402
from benchmarks.speed.threads import scaling  # noqa: E402
from seeing_wind.engine.mpm.autograd import simulate  # noqa: E402
from seeing_wind.engine.mpm.body import Body  # noqa: E402
from seeing_wind.engine.mpm.rollout import rollout  # noqa: E402
from seeing_wind.engine.mpm.state import State  # noqa: E402
from seeing_wind.engine.progress import NoProgress  # noqa: E402

GRID = 64
AGREE = 20
"""Substeps after which all simulators are compared."""
TURN = {"naive Taichi": 5, "Warp": 5, "torch": 1}
"""Substeps of one timed turn, about half a second."""
FRAME = 50
"""Substeps of the timed frame of this solver."""
TOLERANCE = 1e-3
BARS = {
    "corotated": {"ratio_naive_taichi": 8.0, "ratio_warp": 4.0},
    "neo_hookean": {"ratio_naive_taichi": 10.0, "ratio_warp": 5.0},
    "von_mises": {"ratio_naive_taichi": 5.0},
    "viscoplastic": {"ratio_naive_taichi": 5.0},
}
"""What each law must reach on two cores."""


class Ours:
    """This solver on a problem."""

    def __init__(self, problem: Problem, substeps: int = FRAME) -> None:
        self.problem, self.substeps = problem, substeps
        self.model = model_of(problem, substeps)
        self.still = np.zeros((1, len(problem.x), 3))

    def forward(self) -> float:
        """Seconds of the substeps of one frame."""
        body = Body(self.model, "single")
        run = body.packing.start(state_of(self.problem), self.still[0] + self.model.gravity, None, 0, self.substeps)
        return seconds(lambda: body.advance(run, 0, self.substeps, self.substeps, NoProgress()))

    def frame(self) -> State:
        """One frame, packing and sorting included."""
        path = rollout(self.model, state_of(self.problem), self.still, precision="single")
        assert path.substeps[0] == self.substeps, "a substep was too long"
        return path.state(1)

    def both_ways(self) -> tuple[float, float, float]:
        """Seconds of the forward sweep that keeps its states and of the backward sweep, bytes kept per particle and substep."""
        x, v, C, F = (torch.tensor(a, requires_grad=True) for a in (self.problem.x, self.problem.v, self.problem.C, self.problem.F))
        acceleration = torch.zeros(1, len(x), 3, dtype=torch.float64, requires_grad=True)
        start = time.perf_counter()
        outputs = simulate(self.model, x, v, acceleration, C0=C, F0=F, precision="single")
        middle = time.perf_counter()
        kept = outputs[0].grad_fn.runs[0]
        size = kept.bytes / (len(x) * self.substeps)
        torch.autograd.backward([output[1] for output in outputs], [torch.ones_like(output[1]) for output in outputs])
        return middle - start, time.perf_counter() - middle, size


def peers(problem: Problem, skip: list[str]) -> list:
    """The other simulators on the problem."""
    Body(model_of(problem, 1), "single")  # starts Taichi
    from benchmarks.speed.peers.naive_taichi import NaiveTaichi

    found = [NaiveTaichi(problem)]
    if "Warp" not in skip:
        from benchmarks.speed.peers.warp_cpu import WarpCpu

        found.append(WarpCpu(problem))
    if "torch" not in skip:
        from benchmarks.speed.peers.torch_index_add import TorchIndexAdd

        found.append(TorchIndexAdd(problem))
    return found


def disagreement(problem: Problem, others: list) -> dict[str, float]:
    """Largest relative error of each peer's displacements and strains against this solver's after AGREE substeps; warms all up."""
    ours = Ours(problem, AGREE).frame()
    found = {}
    for other in others:
        other.run(AGREE)
        moved, strained = ours.x - problem.x, ours.F - np.eye(3)
        found[other.name] = max(
            float(np.linalg.norm(other.positions() - ours.x) / np.linalg.norm(moved)),
            float(np.linalg.norm(other.deformations() - ours.F) / np.linalg.norm(strained)),
        )
        other.reset()
    return found


def take_turns(ours: Ours, others: list, repeats: int) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], float]:
    """Seconds per substep of everything, each with those of the turn of this solver that it is compared with; bytes kept.

    A peer's turn comes between two of this solver, and is compared with their mean.
    """
    ours.forward(), ours.frame(), ours.both_ways()  # compiled
    rows: dict[str, list[tuple[float, float]]] = {name: [] for name in ("forward", *(other.name for other in others), "frame", "backward")}
    size, before = 0.0, ours.forward()
    for _ in range(repeats):
        for other in others:
            turn = TURN[other.name]
            spent = seconds(lambda: other.run(turn)) / turn  # noqa: B023
            other.reset()
            after = ours.forward()
            rows[other.name].append((spent, 0.5 * (before + after) / FRAME))
            rows["forward"].append((after / FRAME, after / FRAME))
            before = after
        rows["frame"].append((seconds(ours.frame) / FRAME, before / FRAME))
        there, back, size = ours.both_ways()
        rows["backward"].append((back / FRAME, there / FRAME))
        before = ours.forward()
    return {name: tuple(np.array(pairs).T) for name, pairs in rows.items()}, size


def measure(law: str, particles: int, repeats: int, skip: list[str]) -> dict:
    """One case: agreement, then turns."""
    problem = cube(law, particles, GRID)
    others = peers(problem, skip)
    errors = disagreement(problem, others)
    print(f"{law}: relative difference of the final states " + ", ".join(f"{name} {error:.1e}" for name, error in errors.items()))
    if max(errors.values()) > TOLERANCE:
        sys.exit(f"{law}: the simulators do not agree within {TOLERANCE:g}; their speeds cannot be compared.")
    ours = Ours(problem)
    turns, size = take_turns(ours, others, repeats)
    speeds = {name: float(particles / np.median(times)) for name, (times, _) in turns.items()}
    ratios = {name: float(np.median(times / beside)) for name, (times, beside) in turns.items()}
    case = {
        "law": law, "particles": particles, "grid": GRID, "forward_per_s": speeds["forward"],
        "backward_over_forward": ratios["backward"], "bytes_per_particle_substep": size, "backward_per_s": speeds["backward"],
        "frame_over_forward": ratios["frame"],
    }  # fmt: skip
    for other, key in (("naive Taichi", "naive_taichi"), ("Warp", "warp"), ("torch", "torch")):
        if other in speeds:
            case |= {f"ratio_{key}": ratios[other], f"{key}_per_s": speeds[other], f"difference_{key}": errors[other]}
    return case


def cost(counts: tuple[int, ...]) -> list[dict]:
    """Nanoseconds per particle and substep at growing numbers of particles, eight per cell."""
    rows = []
    for count in counts:
        ours = Ours(cube("corotated", count, GRID))
        ours.frame()
        best = min(seconds(ours.frame) for _ in range(1 + min(20, 200_000 // count)))
        spent = best / ours.substeps
        rows.append({"particles": count, "seconds_per_substep": spent, "ns_per_particle_substep": spent / count * 1e9})
        print(f"{count:>9} particles: {spent * 1e3:8.2f} ms a substep, {spent / count * 1e9:.0f} ns each")
    return rows


def draw(cases: list[dict], rows: list[dict]) -> None:
    """Bar chart of speeds, and cost against particles."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    series = [("Seeing Wind", "forward_per_s", "#1f77b4"), ("Seeing Wind, adjoint", "backward_per_s", "#8fbfe0"),
              ("Warp 1.x, CPU", "warp_per_s", "#76b900"), ("Taichi, atomics and ti.svd", "naive_taichi_per_s", "#d98a29"),
              ("torch, index_add", "torch_per_s", "#b04a4a")]  # fmt: skip
    figure, axes = plt.subplots(figsize=(9, 4.2))
    for k, (label, key, colour) in enumerate(series):
        values = [case.get(key, 0.0) / 1e6 for case in cases]
        bars = axes.bar(np.arange(len(cases)) + 0.16 * (k - 2), values, 0.15, label=label, color=colour)
        axes.bar_label(bars, [f"{value:.1f}" if value else "" for value in values], fontsize=7)
    axes.set_xticks(range(len(cases)), [case["law"].replace("_", "-") for case in cases])
    axes.set_ylabel("million particle-substeps per second")
    axes.set_title(f"{cases[0]['particles']:,} particles, grid {GRID}, {os.cpu_count()} cores, single precision")
    axes.legend(frameon=False, fontsize=8)
    axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(ROOT / "benchmarks/results/mpm.png", dpi=130)

    figure, axes = plt.subplots(figsize=(6, 4))
    counts, spent = np.array([row["particles"] for row in rows]), np.array([row["seconds_per_substep"] for row in rows])
    axes.loglog(counts, 1e3 * spent, "o-", label="measured")
    axes.loglog(counts, 1e3 * spent[-1] * counts / counts[-1], "--", color="grey", label="proportional to particles")
    axes.set_xlabel("particles (eight per cell)")
    axes.set_ylabel("ms per substep")
    axes.set_title(f"Cost of a substep, corotated, {os.cpu_count()} cores")
    axes.legend(frameon=False)
    axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(ROOT / "docs/mpm_cost.png", dpi=130)


def report(cases: list[dict]) -> None:
    """A row per law, with what it must reach."""
    print(f"\n{'law':13} {'forward/s':>10} {'frame':>6} {'backward':>9} {'naive':>7} {'Warp':>7} {'torch':>7} {'bytes':>6}   wanted")
    for case in cases:
        cells = [f"{case[key]:6.1f}x" if (key := f"ratio_{name}") in case else "      -" for name in ("naive_taichi", "warp", "torch")]
        bars = BARS[case["law"]].items()
        wanted = [f"{key.removeprefix('ratio_')} >= {bar:g}{'' if case.get(key, 0) >= bar else ' MISSED'}" for key, bar in bars]
        wanted.append("backward <= 2.5" + ("" if case["backward_over_forward"] <= 2.5 else " MISSED"))
        wanted.append("bytes <= 100" + ("" if case["bytes_per_particle_substep"] <= 100.0 else " MISSED"))
        print(
            f"{case['law']:13} {case['forward_per_s'] / 1e6:8.2f} M {case['frame_over_forward']:5.2f}x "
            f"{case['backward_over_forward']:8.2f}x {' '.join(cells)} {case['bytes_per_particle_substep']:6.1f}   {', '.join(wanted)}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--repeats", type=int, default=11)
    parser.add_argument("--skip", nargs="*", default=[], choices=["Warp", "torch"], help="peers to leave out")
    parser.add_argument("--laws", nargs="*", default=list(LAWS), choices=LAWS)
    options = parser.parse_args()
    cases = [measure(law, options.particles, options.repeats, options.skip) for law in options.laws]
    report(cases)
    print()
    threads = scaling(options.particles, 6 * options.repeats)
    print()
    rows = cost((1_000, 10_000, 100_000, 1_000_000))
    draw(cases, rows)
    machine = {"processor": platform.processor() or platform.machine(), "cores": os.cpu_count(), "python": platform.python_version()}
    found = {"cases": cases, **threads, "cost": rows, "machine": machine}
    (ROOT / "benchmarks/results/mpm.json").write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
