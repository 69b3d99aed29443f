"""Tracks of the object's points, in pixels.

    tracker.py     up to 200 corners from frame to frame   anchor.py      patches aligned with the frame where they began
    neighbours.py  checking points by their neighbours     reseed.py      tracks that begin later
    centroid.py    one track for a small or plain body     dense_flow.py  optical flow, for one of the paper's losses
    file.py        tracks from a file                      recognise.py   points that are found again after they were hidden
    outside.py     given tracks that leave the outline
"""
