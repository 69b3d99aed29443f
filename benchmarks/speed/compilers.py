"""Quadrants beside Taichi, behind the same kernels, in one run: `make benchmark-compilers`, or benchmarks/speed/compilers.py [--rounds N]

Every process takes its compiler from SEEING_WIND_COMPILER and has a folder of compiled kernels of its own. The two take turns, and a
ratio is the median over the rounds of Quadrants' seconds over Taichi's within each, so that a machine that is slower for a while is so
for both: below 1 Quadrants is faster. Beside it the same of the processor's seconds, which say more where others use the machine too.
Writes benchmarks/results/compilers.json.

    import        of the compiler and its start
    first kernel  one frame of eight particles and its gradient, from the compiler's import on: nothing compiled before, and all
    launch        of the large body's substep, hardly anything to do: the compiler's own interface, and `compiler.launch.Launcher`
    substeps      the rows of benchmarks/speed/mpm.py, forwards, and both ways with the states kept
    recovery      a whole quick `recover`: nothing compiled before (one round), and all
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

COMPILERS = ("taichi", "quadrants")
PARTS = ("beginnings", "recoveries", "substeps")
LAUNCHES = 500
"""Of one timing of a launch."""


# -- in a process of one compiler ---------------------------------------------------------------------------------------------------


def now() -> np.ndarray:
    """Seconds on the clock, and of the processor for this process and those that it has waited for."""
    used = os.times()
    return np.array([time.perf_counter(), time.process_time() + used.children_user + used.children_system])


def start() -> dict[str, list[float]]:
    """The compiler's import and start, beside PyTorch, which every job of the engine has and Quadrants imports where it is not yet."""
    import torch  # noqa: F401

    began = now()
    from seeing_wind.engine.mpm.compiler import device

    device.start()
    return {"import": list(now() - began)}


def first() -> dict[str, list[float]]:
    """Until a frame of eight particles and its gradient are there, in double precision."""
    import torch

    began = now()

    from benchmarks.speed.peers.ours import model_of
    from benchmarks.speed.peers.problem import cube
    from seeing_wind.engine.mpm.autograd import simulate

    problem = cube("corotated", 8, 64)
    x, v, F = (torch.tensor(a, requires_grad=True) for a in (problem.x, problem.v, problem.F))
    outputs = simulate(model_of(problem, 2), x, v, torch.zeros(1, len(x), 3, dtype=torch.float64), F0=F)
    outputs[0][-1].sum().backward()
    return {"first kernel": list(now() - began)}


def launch() -> dict[str, list[float]]:
    """A launch through the compiler's own interface, and through ours."""
    from benchmarks.speed.peers.ours import model_of, state_of
    from benchmarks.speed.peers.problem import cube
    from seeing_wind.engine.mpm.body import Body
    from seeing_wind.engine.mpm.kernels import parallel_forward
    from seeing_wind.engine.progress import NoProgress

    problem = cube("corotated", 8, 64)
    body, launched = Body(model_of(problem, 1), "single"), []
    ours = body.forward_kernel
    body.forward_kernel = lambda *arguments: (launched.append(arguments), ours(*arguments))
    run = body.packing.start(state_of(problem), np.zeros((8, 3)), None, 0, 1)
    body.advance(run, 0, 1, 1, NoProgress())
    found = {}
    for name, call in (("launch, its own interface", parallel_forward.substeps), ("launch, Launcher", ours)):
        rounds = []
        for _ in range(5):
            began = now()
            for _ in range(LAUNCHES):
                body.roster[:] = 0
                call(*launched[0])
            rounds.append(list((now() - began) / LAUNCHES))
        found[name] = min(rounds)
    return found


def serve(particles: int) -> None:
    """Times a turn of a law for every line that comes in: a frame's substeps, with the states kept, and its way back."""
    from benchmarks.speed.mpm import GRID, Ours
    from benchmarks.speed.peers.problem import LAWS, cube

    ours = {law: Ours(cube(law, particles, GRID), 20) for law in LAWS}
    for law in LAWS:
        ours[law].forward(), ours[law].both_ways()
    print("READY", flush=True)
    for line in sys.stdin:
        turn, began = ours[line.strip()], now()
        forward = turn.forward()
        middle = now()
        there, back, _ = turn.both_ways()
        spent = [[forward, (middle - began)[1]], [there + back, (now() - middle)[1]]]
        print("TURN", json.dumps((np.array(spent) / turn.substeps).tolist()), flush=True)


MEASURES = {"start": start, "first": first, "launch": launch}


# -- the two beside each other ------------------------------------------------------------------------------------------------------


class Side:
    """One compiler: its processes, and its folder of compiled kernels."""

    def __init__(self, name: str, work: Path) -> None:
        self.name, self.cache = name, work / f"kernels_{name}"
        caches = {"TI_OFFLINE_CACHE_FILE_PATH": str(self.cache), "QD_OFFLINE_CACHE_FILE_PATH": str(self.cache)}
        self.environment = {**os.environ, "SEEING_WIND_COMPILER": name, **caches}
        self.take = work / f"{name}.take"

    def forget(self) -> None:
        """As if nothing had ever been compiled."""
        shutil.rmtree(self.cache, ignore_errors=True)

    def measure(self, what: str) -> dict[str, list[float]]:
        """What a process of its own finds."""
        command = [sys.executable, __file__, "--measure", what]
        done = subprocess.run(command, env=self.environment, stdout=subprocess.PIPE, text=True, check=True)
        return json.loads(done.stdout.splitlines()[-1])

    def recover(self, clip: Path) -> np.ndarray:
        """`now` of a quick recovery of the clip."""
        shutil.rmtree(self.take, ignore_errors=True)
        command = [
            sys.executable, "-m", "seeing_wind.engine", "recover", clip / "clip.mp4", "--take", self.take, "--mask", clip / "mask_0000.png",
            "--camera", clip / "camera.json", "--distance", "2", "--material", "leaf", "--particles", "200",
        ]  # fmt: skip
        began = now()
        subprocess.run(command, env=self.environment, cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
        return now() - began

    def serving(self, particles: int) -> subprocess.Popen:
        """A process that is ready for turns."""
        command = [sys.executable, __file__, "--serve", "--particles", str(particles)]
        process = subprocess.Popen(command, env=self.environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        answer(process, "READY")
        return process


def answer(process: subprocess.Popen, word: str) -> str:
    """The rest of the process's next line that begins with the word."""
    for line in process.stdout:
        if line.startswith(word):
            return line.removeprefix(word)
    raise SystemExit(f"A process of the benchmark ended with {process.wait()}.")


class Table:
    """What both sides took in every round."""

    def __init__(self) -> None:
        self.rows: dict[str, dict[str, list[np.ndarray]]] = {}

    def add(self, name: str, side: Side, spent: Sequence[float]) -> None:
        """spent (2,): as `now`."""
        self.rows.setdefault(name, {compiler: [] for compiler in COMPILERS})[side.name].append(np.asarray(spent))

    def show(self) -> dict[str, dict[str, float]]:
        """Prints and returns the medians and the ratios."""
        found = {}
        print(f"{'':36} {'Taichi':>10} {'Quadrants':>10} {'ratio':>6} {'processor':>9} {'rounds':>6}")
        for name, row in self.rows.items():
            taichi, quadrants = (np.array(row[compiler]) for compiler in COMPILERS)
            ratio, of_processor = np.median(quadrants / taichi, axis=0).tolist()
            before, after = float(np.median(taichi[:, 0])), float(np.median(quadrants[:, 0]))
            found[name] = {"taichi": before, "quadrants": after, "ratio": ratio, "ratio_processor": of_processor, "rounds": len(taichi)}
            print(f"{name:36} {readable(before)} {readable(after)} {ratio:6.2f} {of_processor:9.2f} {len(taichi):6}", flush=True)
        return found


def readable(seconds: float) -> str:
    """In ten characters, with a unit."""
    scale, unit = next((s, u) for s, u in ((1.0, "s "), (1e3, "ms"), (1e6, "us")) if seconds * s >= 1.0 or u == "us")
    return f"{seconds * scale:7.2f} {unit}"


def beginnings(sides: list[Side], table: Table, rounds: int) -> None:
    """What it takes until the solver runs, and to launch it."""
    for side in sides:
        side.measure("start")  # the files are read from the disk once
    for _ in range(rounds):
        for side in sides:
            side.forget()
            table.add("import and start", side, side.measure("start")["import"])
            table.add("first kernel, nothing compiled", side, side.measure("first")["first kernel"])
            table.add("first kernel, all compiled", side, side.measure("first")["first kernel"])
    for _ in range(rounds):
        for side in sides:
            for name, spent in side.measure("launch").items():
                table.add(name, side, spent)


def substeps(sides: list[Side], table: Table, rounds: int, particles: int) -> None:
    """Seconds of a substep of so many particles."""
    from benchmarks.speed.peers.problem import LAWS

    processes = [side.serving(particles) for side in sides]
    for law in LAWS:
        for turn in range(rounds):
            order = list(zip(sides, processes))
            for side, process in order[:: 1 if turn % 2 else -1]:
                process.stdin.write(law + "\n")
                process.stdin.flush()
                forward, both_ways = json.loads(answer(process, "TURN"))
                table.add(f"substep, {law}", side, forward)
                table.add(f"substep both ways, {law}", side, both_ways)
    for process in processes:
        process.stdin.close()
        process.wait()


def recoveries(sides: list[Side], table: Table, rounds: int, clip: Path) -> None:
    """Seconds of whole quick recoveries."""
    if not (clip / "clip.mp4").is_file():
        small = ["--frames", "10", "--size", "320x180", "--samples", "4"]
        maker = [sys.executable, "sample_scenes/falling_leaf/make.py", "--out", clip, *small]
        subprocess.run(maker, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    for side in sides:
        side.forget()
        table.add("quick recovery, nothing compiled", side, side.recover(clip))
    for turn in range(rounds):
        for side in sides[:: 1 if turn % 2 else -1]:
            table.add("quick recovery, all compiled", side, side.recover(clip))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--clip", type=Path, default=ROOT / "build/compilers/clip", help="made by the demo's scene where it is not there")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS)
    parser.add_argument("--work", type=Path, default=ROOT / "build/compilers", help="for takes and compiled kernels")
    parser.add_argument("--results", type=Path, default=ROOT / "benchmarks/results/compilers.json")
    parser.add_argument("--measure", choices=MEASURES, help="be one of the processes")
    parser.add_argument("--serve", action="store_true", help="be one of the processes")
    options = parser.parse_args()
    if options.measure:
        print(json.dumps(MEASURES[options.measure]()))
        return
    if options.serve:
        serve(options.particles)
        return
    options.work.mkdir(parents=True, exist_ok=True)
    sides, table = [Side(name, options.work) for name in COMPILERS], Table()
    versions = {name: importlib.metadata.version(name) for name in COMPILERS}
    parts = {
        "beginnings": lambda: beginnings(sides, table, options.rounds),
        "recoveries": lambda: recoveries(sides, table, options.rounds, options.clip),
        "substeps": lambda: substeps(sides, table, 3 * options.rounds, options.particles),
    }
    for name in options.parts:
        parts[name]()
    found = {"seconds": table.show(), "versions": versions, "cores": os.cpu_count(), "particles": options.particles}
    options.results.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
