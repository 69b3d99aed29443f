"""The outline of the object.

    first_mask.py  in frame 0: from a PNG, points, a depth map, or what moves
    from_box.py    in frame 0: what moves together in a box
    moving         what frame 0 shows moving there, in the next frames or later; and what else moves beside the object
    cutting.py     a region by its colours, without specks, and its hull
    evidence.py    what speaks for each pixel, in log odds that are added up
    carried.py     a part of the frame, carried along from one to the next
    corrected.py   the user's corrections in any frame, taken along to the others
    follow.py      carried from one frame to the next
    through.py     that through the whole clip
    rim.py         without the shadow that hangs on it, and cut in the middle of its blur
    motion.py      how the object moved between two frames
    by_turns.py    frame 0 and the background, each found by the other
    background.py  what is behind it, and where that is known
"""
