"""How many times as fast as one thread all are, beside what the machine has to give:
benchmarks/speed/threads.py [--particles N] [--rounds N]

Where a machine is shared with others, two cores are not always two. So three things take turns of a few substeps: one thread on a body;
all threads on it; and a process on every core, each with one thread on a body of its own, which only the machine can hold up. On Linux
in a virtual machine, rounds in which the host took its processors away for longer than a moment are left out.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.speed.peers.ours import model_of, seconds, state_of  # noqa: E402
from benchmarks.speed.peers.problem import cube  # noqa: E402
from seeing_wind.engine.mpm.body import Body  # noqa: E402
from seeing_wind.engine.mpm.compiler import device  # noqa: E402
from seeing_wind.engine.progress import NoProgress  # noqa: E402

GRID = 64
TURN = 10
"""Substeps of a turn, a tenth to a fifth of a second: short, so that what holds the machine up falls into few turns."""
MOST_STOLEN = 0.05
"""Of the processors' time in a round that counts."""
WANTED = 1.7


class Turns:
    """A body whose turns are all the same: packed once, then driven on."""

    def __init__(self, particles: int, tasks: int | None) -> None:
        problem = cube("corotated", particles, GRID)
        model = model_of(problem, TURN)
        self.body = Body(model, "single", tasks=tasks)
        self.start = lambda: self.body.packing.start(state_of(problem), np.zeros((particles, 3)) + model.gravity, None, 0, TURN)
        self.turn()

    def turn(self) -> float:
        """Seconds of a turn's substeps."""
        run = self.start()
        return seconds(lambda: self.body.advance(run, 0, TURN, TURN, NoProgress()))


class Elsewhere:
    """The same on one thread in a process of its own."""

    def __init__(self, particles: int) -> None:
        command = [sys.executable, __file__, "--particles", str(particles), "--serve"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.answer("ready")

    def answer(self, word: str) -> float:
        """The number behind a word of the process; Taichi prints lines of its own."""
        for line in self.process.stdout:
            if line.startswith(word):
                return float(line.split()[1])
        raise SystemExit(f"A process of the benchmark ended with {self.process.wait()}.")

    def end(self) -> None:
        self.process.stdin.close()
        self.process.wait()

    def begin(self) -> None:
        """Asks for a turn."""
        print(file=self.process.stdin, flush=True)


def stolen() -> float:
    """Seconds that the host of a virtual machine has withheld its processors, all together; 0 where no one says."""
    statistics = Path("/proc/stat")
    return int(statistics.read_text().split()[8]) / os.sysconf("SC_CLK_TCK") if statistics.exists() else 0.0


def serve(particles: int) -> None:
    """Takes a turn for every line that comes in."""
    alone = Turns(particles, tasks=1)
    print("ready 0", flush=True)
    for _ in sys.stdin:
        print("turn", alone.turn(), flush=True)


def scaling(particles: int, rounds: int) -> dict[str, float]:
    """Medians over the rounds that count of how many times as fast all threads are, and as many processes; prints them."""
    alone, together = Turns(particles, tasks=1), Turns(particles, tasks=None)
    others = [Elsewhere(particles) for _ in range(device.cores() - 1)]
    threads, processes, withheld = [], [], []
    for _ in range(rounds):
        start, taken = time.perf_counter(), stolen()
        threads.append(alone.turn() / together.turn())
        before = alone.turn()
        for other in others:
            other.begin()
        mine = alone.turn()
        processes.append(sum(before / spent for spent in (mine, *(other.answer("turn") for other in others))))
        withheld.append((stolen() - taken) / (device.cores() * (time.perf_counter() - start)))
    for other in others:
        other.end()
    counts = np.array(withheld) <= MOST_STOLEN
    if not counts.any():
        print(f"The host withheld {np.median(withheld):.0%} of the processors' time: all {rounds} rounds count, for what they are worth.")
        counts[:] = True
    found = {"scaling_1_to_2_threads": threads, "scaling_1_to_2_processes": processes}
    found = {name: float(np.median(np.array(ratios)[counts])) for name, ratios in found.items()}
    reached = found["scaling_1_to_2_threads"]
    print(
        f"{device.cores()} threads are {reached:.2f} times as fast as one, wanted >= {WANTED}{'' if reached >= WANTED else ' MISSED'} "
        f"({counts.sum()} of {rounds} rounds; {np.median(threads):.2f} over all); as many processes with nothing in common "
        f"{found['scaling_1_to_2_processes']:.2f} times"
    )
    return found | {"scaling_rounds": int(counts.sum())}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--particles", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=60)
    parser.add_argument("--serve", action="store_true", help="be one of the processes")
    options = parser.parse_args()
    serve(options.particles) if options.serve else scaling(options.particles, options.rounds)


if __name__ == "__main__":
    main()
