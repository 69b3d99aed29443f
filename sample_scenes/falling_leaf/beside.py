"""How far beside the leaf the recovered wind is right: sample_scenes/falling_leaf/beside.py DIR, with DIR as demo.py made it (build/demo).

At random places of the field's box in all frames, against the known wind, by their distance from the leaf in that frame:

    of the box    share of the places
    confidence    its mean
    size          root mean square of the recovered force there, over that on the leaf
    off           root mean square error of the force, over the size of the true one; no force at all would be 100 % off
    best share    factor on the recovered force with the least error
    Fade          what the reach *Fade* leaves of it
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "sample_scenes" / "common"), str(ROOT)]  # a script of the source tree: it runs with the package installed or not

if __name__ == "__main__":
    from needs import tell_missing_packages

    tell_missing_packages()

import numpy as np  # noqa: E402

from seeing_wind.engine.field import distances, load_field, sample_points  # noqa: E402
from seeing_wind.engine.record_arrays import read_recovery  # noqa: E402
from seeing_wind.engine.recovery.resimulate.in_field import Reach  # noqa: E402
from seeing_wind.engine.take import Take  # noqa: E402

PLACES = 3000
EDGES = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 6.0, 8.0, np.inf)
"""Of the classes of distance [leaf's radii]: a radius is the root mean square distance of the particles from their middle."""
FADE = 0.75
"""Of the box's longest side: the panel's choice."""


def main() -> None:
    """A row per class."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    folder = parser.parse_args().folder
    field, known = load_field(folder / "wind.take" / "field.safetensors"), load_field(folder / "clip" / "known_wind.safetensors")
    x = read_recovery(Take(folder / "wind.take")).x
    places = np.random.default_rng(0).uniform(*field.box, (field.frames, PLACES, 3))
    found, confidence = sample_points(field, places)
    true, away = sample_points(known, places)[0], distances(field, places)
    on, radius = _size(sample_points(field, x[:-1])[0]), np.sqrt(x[0].var(axis=0).sum())
    left, _ = Reach(fade=FADE * float(np.ptp(field.box, axis=0).max())).left(away)
    print("radii        of the box  confidence  size    off  best share  Fade")
    for low, high in zip(EDGES, EDGES[1:]):
        there = (away >= low * radius) & (away < high * radius)
        if not there.any():
            continue
        f, truth = found[there], true[there]
        print(
            f"{low:4.2f} to {high:4.2f} {100 * there.mean():10.1f} % {confidence[there].mean():10.2f} {_size(f) / on:6.2f} "
            f"{100 * _size(f - truth) / _size(truth):4.0f} % {(f * truth).sum() / (f**2).sum():10.2f} {left[there].mean():6.2f}"
        )


def _size(vectors: np.ndarray) -> float:
    return float(np.sqrt((vectors**2).sum(axis=-1).mean()))


if __name__ == "__main__":
    main()
