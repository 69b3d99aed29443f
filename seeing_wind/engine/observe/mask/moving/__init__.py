"""What frame 0 shows moving: the evidence from which an object in a box is begun.

    soon.py   in the next frames
    later.py  in any frame, for what rests first, until a hand comes and pushes it
    in_box.py which of both
"""
