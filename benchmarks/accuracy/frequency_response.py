"""How much of a gust is found, by its frequency: benchmarks/accuracy/frequency_response.py FOLDER TAKES IMAGE NAME ...

FOLDER/truth/NAME.npz are scenes of `held_scenes.py`, TAKES/NAME.take what `recover-trajectories` made of them. Of the mean force across the
body it prints and draws, over the frequency in first natural frequencies: the gain (the part of the true gust that is found, in phase and
size), and what is left of the gust when what was found is taken from it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib
import numpy as np
from truth import sampled

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

EDGES = np.array([0.0, 0.3, 0.6, 0.85, 1.15, 1.6, 2.5, 4.0])
"""Edges of the frequency bands, relative to the first natural frequency."""


def main() -> None:
    """A table and a frame."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("takes", type=Path, metavar="TAKES")
    parser.add_argument("image", type=Path, metavar="IMAGE")
    parser.add_argument("name", nargs="+", metavar="NAME")
    options = parser.parse_args()
    tables = {}
    for name in options.name:
        with np.load(options.folder / "truth" / f"{name}.npz", allow_pickle=False) as truth:
            tables[name] = response(dict(truth), options.takes / f"{name}.take")
    print("f / f1          " + "".join(f"{low:>7.2f}-{high:<4.2f}" for low, high in zip(EDGES, EDGES[1:])))
    for name, (gain, left) in tables.items():
        print(f"{name:10s} gain " + "".join(f"{value:12.2f}" for value in gain))
        print(f"{'':10s} left " + "".join(f"{value:12.2f}" for value in left))
    draw(tables, options.image)


def natural_frequency(truth: dict[str, np.ndarray]) -> float:
    """f1 [Hz] of a post that is held at its top, by Euler and Bernoulli, along its thinner side."""
    x, held = truth["x"][0], truth["fixed"]
    spread = np.sort(x[~held].std(axis=0))
    length = float(np.ptp(x[~held][:, 2]))
    # h² / 12 is the variance of a section of thickness h.
    return float(1.875**2 / (2.0 * np.pi * length**2) * np.sqrt(truth["E"] / truth["rho"]) * spread[0])


def response(truth: dict[str, np.ndarray], take: Path) -> tuple[np.ndarray, np.ndarray]:
    """Gain and relative error in each band of `EDGES`; NaN where the true gust has hardly any energy."""
    free = ~truth["fixed"]
    want = truth["acc"][:, free, :2].mean(axis=1)
    got = sampled(take, truth["x"][:-1])[:, free, :2].mean(axis=1) / float(truth["rho"])
    window = np.hanning(len(want))[:, None]
    true, found = (np.fft.rfft(window * (series - series.mean(axis=0)), axis=0) for series in (want, got))
    band = np.digitize(np.fft.rfftfreq(len(want), 1.0 / float(truth["fps"])) / natural_frequency(truth), EDGES) - 1
    gain, left = (np.full(len(EDGES) - 1, np.nan) for _ in range(2))
    whole = (np.abs(true) ** 2).sum()
    for k in range(len(gain)):
        power = (np.abs(true[band == k]) ** 2).sum()
        if power > 1e-4 * whole:
            gain[k] = np.abs((found[band == k] * true[band == k].conj()).sum()) / power
            left[k] = np.sqrt((np.abs(found[band == k] - true[band == k]) ** 2).sum() / power)
    return gain, left


def draw(tables: dict[str, tuple[np.ndarray, np.ndarray]], image: Path) -> None:
    """Gain and what is left, a line for each scene."""
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 3.6), sharex=True, layout="constrained")
    middle = 0.5 * (EDGES[1:] + EDGES[:-1])
    for name, values in tables.items():
        for one, series in zip(axes, values):
            one.plot(middle, series, marker="o", label=name)
    for one, title in zip(axes, ("gain: found over true", "left: error over true")):
        one.set(title=title, xlabel="frequency / first natural frequency", ylim=(0.0, 1.6), xlim=(0.0, EDGES[-1]))
        one.axhline(1.0, color="0.7", linewidth=0.8, zorder=0)
        one.grid(alpha=0.3)
    axes[0].legend(frameon=False)
    figure.savefig(image, dpi=110)


if __name__ == "__main__":
    main()
