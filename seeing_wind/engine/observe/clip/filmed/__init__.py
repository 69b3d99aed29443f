"""How a clip was filmed, where that spoils what is seen in it. Each finding is a `records.Doubt`, told as it is found and kept.

    combing.py       two fields in one frame: interlaced video
    container.py     what an MP4 file says of itself: slow motion, high dynamic range
    surroundings.py  what the still background does: focus that breathes, rows that are read one after the other
    beside.py        what moves along beside the object: a rope, a hand, another thing
"""
