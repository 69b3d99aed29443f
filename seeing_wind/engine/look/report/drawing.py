"""What is drawn over a frame: arrows that are visible on any background, and the instruments: colour bar, force dial, frame and time."""

from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from ...conventions import in_figures
from .colours import force_colours

OUTLINE = (18, 20, 24)
"""Dark, so that light arrows stand out on light frames."""
GROUND = (16, 18, 22, 158)
"""RGBA of the panels behind the instruments."""

INK, FAINT = (244, 245, 247), (182, 188, 198)


class Dials:
    """Instruments for frames of `size` (width, height) px.

    Args:
        top: force density [N/m³] at the colour bar's upper end.
        strongest: largest mean force density [N/m³] in the clip, which reaches the dial's rim.
    """

    def __init__(self, size: tuple[int, int], top: float, strongest: float) -> None:
        self.size, self.top, self.strongest = size, top, max(strongest, 1e-12)
        self.unit = min(size[0] / 960, size[1] / 540)
        fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
        self.small = ImageFont.truetype(str(fonts / "DejaVuSans.ttf"), round(12.5 * self.unit))
        self.bold = ImageFont.truetype(str(fonts / "DejaVuSans-Bold.ttf"), round(15 * self.unit))
        self.centre, self.radius = (62 * self.unit, size[1] - 62 * self.unit), 40 * self.unit
        panels = np.asarray(self._panels()).astype(np.float32)
        self._alpha = panels[..., 3:] / 255
        self._panel = panels[..., :3] * self._alpha

    def draw(self, canvas: np.ndarray, seen: np.ndarray, mean: np.ndarray, frame: int, seconds: float) -> None:
        """Draw the instruments into `canvas` (H, W, 3) RGB.

        Args:
            seen: (3,) mean force density in the camera's axes [N/m³]; mean: the same in world axes.
            frame, seconds: the frame's number and time.
        """
        canvas[:] = (canvas * (1 - self._alpha) + self._panel + 0.5).astype(np.uint8)
        strength = float(np.linalg.norm(mean))
        colour = tuple(force_colours(np.array(strength / self.top)).tolist())
        centre = np.array(self.centre)
        draw_arrow(canvas, centre, centre + seen[:2] / self.strongest * self.radius * 0.96, colour, 1.2 * self.unit)
        u, beside = self.unit, self.centre[0] + self.radius + 14 * self.unit
        self._write(canvas, (beside, self.centre[1] - 9 * u), f"{in_figures(strength)} N/m³", self.bold, INK)
        self._write(canvas, (24 * u, 28 * u), f"{frame:03d}", self.bold, INK)
        self._write(canvas, (66 * u, 28 * u), f"{seconds:.2f} s", self.small, FAINT)

    def _write(
        self, canvas: np.ndarray, place: tuple[float, float], text: str, font: ImageFont.FreeTypeFont, colour: tuple[int, int, int]
    ) -> None:
        """Blend text into the canvas, with the middle of its left edge at `place`."""
        left, upper, right, lower = (round(edge) for edge in font.getbbox(text, anchor="lm"))
        stamp = Image.new("L", (right - left + 2, lower - upper + 2))
        ImageDraw.Draw(stamp).text((1 - left, 1 - upper), text, 255, font, "lm")
        x, y = round(place[0]) + left - 1, round(place[1]) + upper - 1
        patch = canvas[y : y + stamp.height, x : x + stamp.width]
        alpha = np.asarray(stamp)[: patch.shape[0], : patch.shape[1], None].astype(np.float32) / 255
        patch[:] = (patch * (1 - alpha) + np.array(colour) * alpha + 0.5).astype(np.uint8)

    def _panels(self) -> Image.Image:
        """Everything that does not change; drawn four times as large and reduced, because Pillow's shapes are not anti-aliased."""
        fine, (width, height), u = 4, self.size, self.unit
        sheet = Image.new("RGBA", (width * fine, height * fine))
        draw = ImageDraw.Draw(sheet)

        def panel(left: float, upper: float, right: float, lower: float) -> None:
            draw.rounded_rectangle([fine * left, fine * upper, fine * right, fine * lower], fine * 9 * u, GROUND)

        (x, y), r = self.centre, self.radius
        panel(12 * u, 14 * u, 136 * u, 42 * u)
        panel(12 * u, y - r - 10 * u, x + r + 138 * u, y + r + 10 * u)
        for ring, opacity in ((r, 150), (r / 2, 70)):
            corners = [fine * (x - ring), fine * (y - ring), fine * (x + ring), fine * (y + ring)]
            draw.ellipse(corners, outline=(*FAINT, opacity), width=round(fine * 1.3 * u))
        panel(width - 108 * u, 14 * u, width - 12 * u, 238 * u)
        sheet = sheet.resize(self.size, Image.Resampling.LANCZOS)
        self._scale(sheet)
        draw = ImageDraw.Draw(sheet)
        draw.text((x + r + 14 * u, y + 13 * u), "mean force", (*FAINT, 255), self.small, "lm")
        return sheet

    def _scale(self, sheet: Image.Image) -> None:
        """Draw the colour bar with its numbers, top right."""
        u, width = self.unit, self.size[0]
        left, upper, wide, high = round(width - 96 * u), round(48 * u), round(13 * u), round(176 * u)
        colours = force_colours(np.linspace(1, 0, high))[:, None].repeat(wide, axis=1)
        sheet.paste(Image.fromarray(colours.astype(np.uint8)), (left, upper))
        draw = ImageDraw.Draw(sheet)
        draw.text((left, 30 * u), "N/m³", (*INK, 255), self.bold, "lm")
        for part in (0.0, 0.25, 0.5, 0.75, 1.0):
            draw.text((left + wide + 8 * u, upper + (1 - part) * (high - 1)), in_figures(part * self.top, 5), (*INK, 255), self.small, "lm")


def draw_arrow(canvas: np.ndarray, tail: np.ndarray, tip: np.ndarray, colour: tuple[float, ...], size: float) -> None:
    """Draw an anti-aliased arrow with a dark outline into `canvas` (H, W, 3), from `tail` to `tip` (2,) [px]; `size` scales its width."""
    span = tip - tail
    length = float(np.linalg.norm(span))
    if not np.isfinite(length) or length > 4 * max(canvas.shape):
        return
    if length < 2 * size:
        centre = _fixed(tail[None])[0]
        cv2.circle(canvas, (int(centre[0]), int(centre[1])), int(3.4 * size * 16), OUTLINE, -1, cv2.LINE_AA, 4)
        cv2.circle(canvas, (int(centre[0]), int(centre[1])), int(2.2 * size * 16), colour, -1, cv2.LINE_AA, 4)
        return
    along = span / length
    across = np.array([-along[1], along[0]])
    head = min(11.0 * size, 0.62 * length)
    half, wing = min(1.7 * size, 0.2 * head), 0.46 * head
    neck = length - 0.88 * head
    outline = [(0, -half), (neck, -half), (length - head, -wing), (length, 0), (length - head, wing), (neck, half), (0, half)]
    corners = _fixed(np.array([tail + a * along + b * across for a, b in outline]))
    cv2.polylines(canvas, [corners], True, OUTLINE, max(2, round(2.6 * size)), cv2.LINE_AA, 4)
    cv2.fillPoly(canvas, [corners], colour, cv2.LINE_AA, 4)


def _fixed(points: np.ndarray) -> np.ndarray:
    """Points in pixels as OpenCV's fixed-point numbers with four fractional bits."""
    return np.round(points * 16).astype(np.int32)
