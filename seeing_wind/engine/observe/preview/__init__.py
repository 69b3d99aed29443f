"""The preview of a clip: the observation, drawn and judged before anything is solved.

    held.py      where the object seems to be held
    verdicts.py  good or doubtful, and what to do, item by item
    drawing.py   outline, tracks, held place and scale over a frame
"""
