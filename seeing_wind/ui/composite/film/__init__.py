"""What the clip's camera puts on everything that it sees, so that a render can have it too.

grain     its noise, measured in frame 0
softness  how softly it shows a rim, likewise
focus     the depth of field of its lens
lens      where its lens shows what is rendered
"""

from .focus import check_depths, keep_focus, set_focus
from .grain import grain_of
from .lens import Lens, drop_lenses, lens_of
from .softness import softness_of

__all__ = ["Lens", "check_depths", "drop_lenses", "grain_of", "keep_focus", "lens_of", "set_focus", "softness_of"]
