"""What was observed, as residuals of unit variance.

    objective.py     all channels together       channels.py  helpers for both kinds of channel
    tracks.py        tracks of a camera [px]     points.py    points in 3D [m]
    mismatch.py      the covariance of the solver's mismatch
    arc.py           arc lengths of points along a bent body
    clamp_motion.py  a moving clamp, and the body in the clamp's frame
    ringing.py       frames in which a held body swings without a force
    weight.py        whether a held body already bears its weight in frame 0
    constants.py     the sizes of the errors
"""
