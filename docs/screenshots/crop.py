"""Cut the sidebar, with some of the view beside it, out of a picture of the window: crop.py WINDOW.png OUT.png"""

import sys

from PIL import Image

LEFT, TOP, RIGHT, BOTTOM = 900, 45, 1600, 1000
"""Pixels of a window of 1600 x 1000 with the 3D view over all of it."""

WIDE = 420
"""Left edge where the view shows something."""

left = WIDE if sys.argv[2].endswith(("done.png", "field.png")) else LEFT
Image.open(sys.argv[1]).convert("RGB").crop((left, TOP, RIGHT, BOTTOM)).save(sys.argv[2], optimize=True)
