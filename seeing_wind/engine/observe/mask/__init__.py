"""The outline of the object.

    first_mask.py  in frame 0: from a PNG, a box, a depth map, or what moves
    follow.py      carried through the clip
    motion.py      how the object moved between two frames
    background.py  what is behind it, and where that is known
"""
