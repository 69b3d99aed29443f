"""The look of the clip's camera, to be matched by the render.

grain     its noise, measured in frame 0
softness  its blur, measured at the object's rim in frame 0
focus     the depth of field of its lens
lens      the distortion of its lens, as ST maps
"""

from .focus import check_depths, keep_focus, set_focus
from .grain import grain_of
from .lens import Lens, drop_lenses, lens_of
from .softness import softness_of

__all__ = ["Lens", "check_depths", "drop_lenses", "grain_of", "keep_focus", "lens_of", "set_focus", "softness_of"]
