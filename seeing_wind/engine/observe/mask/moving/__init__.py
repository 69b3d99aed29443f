"""What frame 0 shows moving: the evidence from which an object in a box is begun, and other things that move.

    soon.py        in the next frames
    later.py       in any frame, for what rests first, until a hand comes and pushes it
    in_box.py      which of both
    registered.py  the first frames of a camera that moves, as one that stands still would have seen them
    panned.py      what such a camera has shown beside the object so far
    others.py      what else moves beside the object, comes up to it or holds it
"""
