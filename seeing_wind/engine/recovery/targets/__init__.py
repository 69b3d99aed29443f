"""What was observed, as residuals of unit variance.

    objective.py  all channels together       channels.py  what both kinds of channel share
    tracks.py     tracks of a camera [px]     points.py    points in 3D [m]
    mismatch.py   how far the solver's body strays from the filmed one
    arc.py        how far along a bent body its points lie
    clamp_motion.py  a clamp that moves, and the body as seen from it
    ringing.py    when a held body swings by itself
    weight.py     whether it bears its weight as it stands in frame 0
    constants.py  the sizes of the errors
"""
