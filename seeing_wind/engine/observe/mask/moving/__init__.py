"""Which pixels of frame 0 move: the evidence with which the search for an object in a box starts, and other things that move.

    soon.py        what moves in the next frames
    later.py       what moves in any frame, for an object at rest until, say, a hand comes and pushes it
    in_box.py      the choice between these two
    registered.py  the first frames of a moving camera, warped as if it had stood still
    panned.py      the background of a moving camera, from what it has shown beside the object so far
    last_seen.py   where the object was seen last, and where it may come out again once something hides it
    others.py      other things that move beside the object, come up to it or hold it
"""
