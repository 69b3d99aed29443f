"""How a clip was filmed, where that spoils the result. Each finding is a `records.Doubt`, which is shown as a warning and kept.

    combing.py       two fields in one frame: interlaced video
    container.py     an MP4 file's metadata: slow motion, high dynamic range
    surroundings.py  how the still background moves: a lens that refocuses, a rolling shutter
    beside.py        what moves along beside the object: a rope, a hand, another thing
"""
