"""report.png: the recovery on one page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from ...records import Observation, Recovery
from .colours import force_colours

INK, FAINT, GREY, PAPER = "#23272e", "#8a919c", "#c3c8d0", "#ffffff"
AXES = (("x", "#e5484d"), ("y", "#46a758"), ("z", "#3e63dd"))
"""Blender's axis colours."""

STYLE: dict[str, Any] = {"fontsize": 10.5, "color": INK, "loc": "left", "pad": 9, "fontweight": "bold"}


def draw_report(
    path: Path,
    figures: dict[str, Any],
    recovery: Recovery,
    fps: float,
    confidence: np.ndarray,
    observation: Observation | None,
) -> None:
    """Draw four panels (net force, residual, confidence on the body, the first frame) to a PNG.

    Args:
        figures: the report's numbers, as written to report.json.
        confidence: (T, N) of the field at the particles.
        observation: None for a recovery from 3D trajectories; the fourth panel then shows the path instead of a frame.
    """
    # A figure with its own canvas: pyplot would keep global state and choose a back end by the display.
    figure = Figure(figsize=(12.4, 8.2), dpi=120, facecolor=PAPER, layout=ConstrainedLayoutEngine(w_pad=0.14, h_pad=0.14))
    FigureCanvasAgg(figure)
    (force, image), (residual, cover) = figure.subplots(2, 2, width_ratios=(1.15, 1))
    figure.suptitle(_headline(figures), x=0.012, ha="left", fontsize=13, color=INK, fontweight="bold")
    _net_force(force, np.array(figures["net_force"]), fps, recovery.wild)
    _residual(residual, recovery, fps)
    _confidence(cover, figure, recovery, confidence)
    if observation is None:
        _path(image, figure, recovery)
    else:
        _first_frame(image, observation)
    figure.savefig(path, format="png")


def _headline(figures: dict[str, Any]) -> str:
    parts = [f"Recovered force field: {figures['outcome'].replace('_', ' ')} after {figures['iterations']} iterations"]
    if figures["residual"]:
        factor, unit = _display_unit(figures["residual_unit"])
        parts.append(f"residual {factor * figures['residual']['median']:.2f} {unit}")
    parts.append(f"confidence {100 * figures['confidence']['mean']:.0f} %")
    return "   ·   ".join(parts)


def _display_unit(unit: str) -> tuple[float, str]:
    return (1e3, "mm") if unit == "m" else (1.0, unit)


def _dress(axes: Axes, title: str, xlabel: str = "", ylabel: str = "") -> None:
    axes.set_title(title, **STYLE)
    axes.set_xlabel(xlabel, color=FAINT, fontsize=9)
    axes.set_ylabel(ylabel, color=FAINT, fontsize=9)
    axes.tick_params(colors=FAINT, labelsize=8.5, length=0)
    axes.grid(True, color="#edeff2", linewidth=0.9)
    axes.set_axisbelow(True)
    for side, spine in axes.spines.items():
        spine.set_visible(side == "bottom")
        spine.set_color("#c9ced6")


def _net_force(axes: Axes, force: np.ndarray, fps: float, wild: np.ndarray | None) -> None:
    """Draw the net force (T, 3) [N] as steps, because each value holds over its interval; grey where `wild` (T,) bool: it was not seen."""
    unit, factor = ("mN", 1e3) if np.abs(force).max() < 0.1 else ("N", 1.0)
    edges, values = np.arange(len(force) + 1) / fps, factor * force
    _dress(axes, "Net force on the object", "seconds", unit)
    size = np.linalg.norm(values, axis=1)
    axes.stairs(size, edges, fill=True, color="#e9ecf1", label="strength")
    axes.stairs(size, edges, baseline=None, color=FAINT, linewidth=1.0)
    axes.axhline(0, color="#c9ced6", linewidth=0.8)
    unseen = np.zeros(len(force), bool) if wild is None else wild
    for column, (name, colour) in enumerate(AXES):
        axes.stairs(np.where(unseen, np.nan, values[:, column]), edges, baseline=None, color=colour, linewidth=1.8, label=name)
        axes.stairs(np.where(unseen, values[:, column], np.nan), edges, baseline=None, color=GREY, linewidth=1.8)
    if unseen.any():
        axes.stairs([], [0.0], baseline=None, color=GREY, linewidth=1.8, label="not seen")
    axes.set_xlim(edges[0], edges[-1])
    axes.legend(frameon=False, ncols=5, fontsize=8.5, labelcolor=INK, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.2,
                handlelength=1.2, handletextpad=0.5, columnspacing=1.2)  # fmt: skip


def _residual(axes: Axes, recovery: Recovery, fps: float) -> None:
    factor, unit = _display_unit(recovery.residual_unit)
    values, seconds = factor * recovery.residual, np.arange(len(recovery.residual)) / fps
    _dress(axes, "Residual: simulated against observed points, root mean square", "seconds", unit)
    axes.fill_between(seconds, values, color="#3e63dd", alpha=0.10, linewidth=0)
    axes.plot(seconds, values, color="#3e63dd", linewidth=1.8)
    seen = values[np.isfinite(values)]
    if len(seen):
        median = float(np.median(seen))
        axes.axhline(median, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
        axes.annotate(f"median {median:.2f} {unit}", (1, median), (-4, 4), ("axes fraction", "data"), textcoords="offset points",
                      ha="right", fontsize=8.5, color=INK, bbox={"color": PAPER, "alpha": 0.8, "pad": 1.5})  # fmt: skip
        axes.set_ylim(0, 1.18 * float(seen.max()) or 1.0)
    axes.set_xlim(seconds[0], seconds[-1])


def _confidence(axes: Axes, figure: Figure, recovery: Recovery, confidence: np.ndarray) -> None:
    """Draw the mean confidence of each particle on the body in frame 0, from the side that shows most of it."""
    a, b = _broad_axes(recovery.x[0])
    _dress(axes, "Confidence on the object (mean over frames)", f"{'xyz'[a]} [m]", f"{'xyz'[b]} [m]")
    mean = confidence.mean(axis=0)
    depth_axis = 3 - a - b
    order = np.argsort(-recovery.x[0][:, depth_axis])
    dot = float(np.clip(30000 / len(order), 6, 60))
    points = recovery.x[0][order]
    dots = axes.scatter(points[:, a], points[:, b], c=mean[order], s=dot, cmap="viridis", vmin=0, vmax=1, linewidths=0)
    axes.set_aspect("equal", adjustable="datalim")
    _bar(figure, axes, dots)


def _path(axes: Axes, figure: Figure, recovery: Recovery) -> None:
    """Draw the path of the body, coloured by the strength of the force on it."""
    a, b = _broad_axes(recovery.x.reshape(-1, 3))
    _dress(axes, "Path of the object, coloured by force density [N/m³]", f"{'xyz'[a]} [m]", f"{'xyz'[b]} [m]")
    strength = np.linalg.norm(recovery.force_density, axis=-1)
    chosen = slice(None, None, max(1, strength.size // 20000))
    points = recovery.x[:-1].reshape(-1, 3)[chosen]
    palette = ListedColormap(force_colours(np.linspace(0, 1, 256)) / 255)
    dots = axes.scatter(points[:, a], points[:, b], c=strength.ravel()[chosen], s=4, cmap=palette, linewidths=0, alpha=0.7)
    axes.set_aspect("equal", adjustable="datalim")
    _bar(figure, axes, dots)


def _first_frame(axes: Axes, observation: Observation) -> None:
    axes.set_title("First frame: object, tracked points and their paths", **STYLE)
    axes.imshow(observation.image)
    mask = observation.masks[0]
    veil = np.zeros((*mask.shape, 4))
    veil[~mask] = (1, 1, 1, 0.38)
    axes.imshow(veil)
    if mask.any() and not mask.all():
        axes.contour(mask.astype(float), levels=[0.5], colors=["#ff7a1a"], linewidths=1.4)
    paths = np.where(observation.visible[..., None], observation.xy, np.nan)
    for track in range(0, paths.shape[1], max(1, paths.shape[1] // 60)):
        axes.plot(*paths[:, track].T, color="#3e63dd", linewidth=0.7, alpha=0.55)
    shown = paths[0, :: max(1, paths.shape[1] // 150)]
    axes.scatter(shown[:, 0], shown[:, 1], s=7, color="#ffffff", edgecolors="#3e63dd", linewidths=0.8, zorder=3)
    height, width = mask.shape
    axes.set_xlim(-0.5, width - 0.5)
    axes.set_ylim(height - 0.5, -0.5)
    axes.set_axis_off()


def _broad_axes(points: np.ndarray) -> tuple[int, int]:
    """The two axes along which the points spread most, the vertical one last."""
    a, b = sorted(np.argsort(-np.ptp(points, axis=0))[:2])
    return int(a), int(b)


def _bar(figure: Figure, axes: Axes, dots: Any) -> None:
    bar = figure.colorbar(dots, ax=axes, shrink=0.85, aspect=26, pad=0.02)
    bar.outline.set_visible(False)  # type: ignore[operator]
    bar.ax.tick_params(colors=FAINT, labelsize=8.5, length=0)
