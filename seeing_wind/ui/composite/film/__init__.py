"""What the clip's camera puts on everything that it sees, measured in frame 0, so that a render can have it too.

grain     its noise
softness  how softly it shows a rim
"""

from .grain import grain_of
from .softness import softness_of

__all__ = ["grain_of", "softness_of"]
