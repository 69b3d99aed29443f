"""Cut what the guide shows out of frames of the window: crop.py FOLDER OUT"""

import sys
from pathlib import Path

from PIL import Image

TOP, RIGHT, BOTTOM = 45, 1600, 1000
"""Pixels of a window of 1600 x 1000 with the 3D view over all of it."""
PANEL, WIDE = 900, 370
"""Left edge: the sidebar with some of the view beside it, or where the view shows something."""
SHOWN = {
    "idle": ("falling_leaf_0_new", PANEL), "running": ("running", PANEL), "cancelled": ("cancelled", PANEL), "resumed": ("resumed", PANEL),
    "failed": ("failed", PANEL), "object": ("falling_leaf_2_object", WIDE), "done": ("falling_leaf_3_recovered", WIDE),
    "field": ("falling_leaf_4_field", WIDE), "baked": ("falling_leaf_5_baked", WIDE), "composite": ("falling_leaf_6_composite", WIDE),
}  # fmt: skip
"""By the name in the guide: which frame, and where it begins."""

folder, out = Path(sys.argv[1]), Path(sys.argv[2])
for name, (picture, left) in SHOWN.items():
    if (folder / f"{picture}.png").is_file():
        Image.open(folder / f"{picture}.png").convert("RGB").crop((left, TOP, RIGHT, BOTTOM)).save(out / f"{name}.png", optimize=True)
