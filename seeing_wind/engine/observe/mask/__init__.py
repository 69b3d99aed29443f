"""The outline of the object.

    first_mask.py  the mask of frame 0 from a PNG, points, a depth map, or from what moves
    from_box.py    the mask of frame 0 from a box: what moves together in it
    moving         which parts of frame 0 move, in the next frames or later; other moving things beside the object
    cutting.py     segmenting a region by its colours; cleaning up masks; convex hulls
    evidence.py    the evidence that a pixel belongs to the object, in log odds that add up
    carried.py     a set of pixels, such as a network's outline, carried from one frame to the next
    corrected.py   the user's corrections in any frame, carried to the others
    follow.py      carrying the mask from one frame to the next
    through.py     the masks of the whole clip
    rim.py         refining the rim: without attached shadows, ending in the middle of its blur
    motion.py      how the object moved between two frames; windows
    by_turns.py    the outline of frame 0 and the background, each refined with the help of the other
    background.py  what is behind the object, and where that is known
"""
