"""Tables in Markdown beside the paper's numbers, and figures."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib
import numpy as np

from seeing_wind.engine.take import VERSION as ENGINE

from .rows import Row

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402

TITLES = {
    1: "Table 1: force recovery in synthetic scenarios, from pixels",
    2: "Table 2: force representations, from exact trajectories",
    3: "Table 3: objectives, from pixels of one view",
}
NOTES = {
    1: "`--schedule default`. One view is the paper's setting; two views give the engine both cameras (`--view`). The two held plants are "
    "the weakest: how strongly a plant springs back goes with the third power of how thick its stem is taken to be, and a force along "
    "the stem hardly moves it (the sunflower's true force has such a part). On the soft toy the recovery finds the net force only.",
    2: "All but *default* go through `--schedule paper`, where the representation is what descends; *default* is this engine's own solve, "
    "distilled into the causal tri-plane. Trajectories are exact, for the paper's scheme doubles and alternates noise from frame to frame: "
    "0.2 mm on every frame already put it above 100 %. *True particles* are the trajectories of the truth's own particles instead of "
    "coarser ones: simulator and discretisation are then those of the truth, as they may have been in the paper. *From pixels* is Table "
    "3's setting. In the paper the order of the representations is that of whether they reproduce the motion at all (point forces 20 dB). "
    "Here all of them do, so under the paper's schedule they are within some percent of each other and in no order that holds: the causal "
    "tri-plane is ahead of K-Planes from the true particles and behind them from pixels, and point forces are as good as either from exact "
    "trajectories. With the engine's own solve it is ahead of both for every material.",
    3: "All but *default* go through `--schedule paper` on the same tracks, frames and depth of frame 0. For flow_depth, depth is "
    "spread from lifted tracks: no depth network is used.",
}
HEAD = """# The paper's tables

Written by `benchmarks/paper_tables/tables.py` (`make tables`). The paper's scenes are not published: these are scenes of the same kinds,
so the two columns are comparable in kind, not number by number. Objects are solids made by scripts; fields differ from object to object;
there is no gravity. The truth is simulated by this engine's solver with particles 1.4 to 1.7 times finer than the recovery's, on a shifted
lattice (unless a row says *true particles*); a truth from another simulator is scored by `benchmarks/accuracy/truth.py`. Frames are painted
(no cast shadows), 480 x 400, 30 fps, 20 frame intervals. From pixels the engine knows the camera, the silhouette and depth of frame 0,
what is held, and the material.

*Magnitude* and *direction* are the paper's two errors, of the stored field at the true particle positions, held particles left out.
*Uniform* is what a uniform field with the right net force in every frame would score: a recovery that is not well below it has found no
spatial variation. PSNR, SSIM and LPIPS compare the input clip with the motion simulated under the recovered force (from pixels: splatted
Gaussians over the true background). LPIPS stands where its weights are installed. Seconds are of machines that did other things too.
"""
OLDER = "Rows with an asterisk were run with an earlier state of the engine."


def write_report(out: Path, rows: list[dict]) -> str:
    """Write tables.md, tables.json and figures into `out`; returns the Markdown."""
    parts = [HEAD.rstrip()] + ([OLDER] if any(map(_older, rows)) else [])
    for table, title in TITLES.items():
        own = [row for row in rows if row["row"]["table"] == table]
        if not own:
            continue
        parts += [f"## {title}", NOTES[table], markdown(own)]
        figure = f"table{table}.png"
        bars(out / figure, own, title)
        parts.append(f"![errors beside the paper's]({figure})")
    sheet(out / "scenes.png", out / "frames", rows)
    if (out / "scenes.png").is_file():
        parts += [
            "## Scenes",
            "Input, the same motion simulated again, and the force on it: true (black), recovered (red).",
            "![scenes](scenes.png)",
        ]
    parts += ["## Rows above the paper's errors", compare(rows)]
    text = "\n\n".join(parts) + "\n"
    (out / "tables.md").write_text(text, encoding="utf-8")
    (out / "tables.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return text


def markdown(rows: list[dict]) -> str:
    """One table; the paper's numbers in brackets."""
    lines = [
        "| row | material | PSNR | SSIM | LPIPS | magnitude % | direction ° | uniform % / ° | seconds |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        paper = row["row"]["paper"]
        cells = [_beside(row["psnr"], paper[0], 2), _beside(row["ssim"], paper[1], 3), _beside(row["lpips"], paper[2], 3)]
        cells += [_beside(row["magnitude"], paper[3], 1), _beside(row["direction"], paper[4], 1)]
        flat = f"{row['uniform_magnitude']:.0f} / {row['uniform_direction']:.0f}"
        name = row["row"]["name"] + (" *" if _older(row) else "")
        lines.append(f"| {name} | {row['kind']} | {' | '.join(cells)} | {flat} | {row['engine_seconds'] or 0:.0f} |")
    return "\n".join(lines)


def compare(rows: list[dict]) -> str:
    """Names every row with an error above the paper's."""
    lines = []
    for row in rows:
        paper = row["row"]["paper"]
        above = [
            f"{what} {row[key]:.1f} against {paper[at]:.1f}"
            for what, key, at in (("magnitude", "magnitude", 3), ("direction", "direction", 4))
            if row[key] > paper[at]
        ]
        if above:
            lines.append(f"- Table {row['row']['table']}, {row['row']['name']}: {', '.join(above)}.")
    return "\n".join(lines) if lines else f"None of the {len(rows)} rows that were run."


def bars(path: Path, rows: list[dict], title: str) -> None:
    """Errors of this engine, of the paper, and of a uniform field, side by side."""
    figure, axes = pyplot.subplots(1, 2, figsize=(11, 1.2 + 0.42 * len(rows)), sharey=True, layout="constrained")
    place = np.arange(len(rows))[::-1]
    for axis, key, at, unit in zip(axes, ("magnitude", "direction"), (3, 4), ("magnitude error [%]", "direction error [degrees]")):
        axis.barh(place + 0.25, [row[key] for row in rows], 0.25, color="#c8502d", label="here")
        axis.barh(place, [row["row"]["paper"][at] for row in rows], 0.25, color="#5a6f8c", label="paper")
        axis.barh(place - 0.25, [row[f"uniform_{key}"] for row in rows], 0.25, color="#c9c9c9", label="uniform field")
        axis.set_xlabel(unit)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_yticks(place, [row["row"]["name"] for row in rows])
    axes[1].legend(frameon=False)
    figure.suptitle(title, x=0.01, ha="left")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def sheet(path: Path, kept: Path, rows: list[dict]) -> None:
    """One line per object: input, again, forces. Nothing is drawn when no row left frames of one of the objects."""
    shown: dict[str, Path] = {}
    for row in rows:
        file = kept / f"{Row(**row['row']).key}.npz"
        if file.is_file():
            shown.setdefault(row["row"]["thing"], file)
    if len(shown) < len({row["row"]["thing"] for row in rows}):
        return
    figure, axes = pyplot.subplots(len(shown), 3, figsize=(9.6, 2.7 * len(shown)), layout="constrained", squeeze=False)
    for line, (thing, file) in zip(axes, shown.items()):
        with np.load(file, allow_pickle=False) as data:
            want, seen, start, true_tip, got_tip = (data[key] for key in ("want", "seen", "start", "true_tip", "got_tip"))
        for axis, image in zip(line, (want[1], seen[1], want[0])):
            axis.imshow(image)
            axis.set_axis_off()
        line[0].set_title(f"{thing}: input, last frame", fontsize=9, loc="left")
        line[1].set_title("simulated with the recovered force", fontsize=9, loc="left")
        line[2].set_title("force in the middle of the clip", fontsize=9, loc="left")
        for tip, colour, width in ((true_tip, "black", 0.006), (got_tip, "#d62f1f", 0.0035)):
            line[2].quiver(*start.T, *(tip - start).T, color=colour, angles="xy", scale_units="xy", scale=1.0, width=width)
    figure.savefig(path, dpi=100)
    pyplot.close(figure)


def _older(row: dict) -> bool:
    return row.get("engine") != ENGINE


def _beside(value: float | None, paper: float, digits: int) -> str:
    return f"{'–' if value is None else f'{value:.{digits}f}'} ({paper:g})"
