"""Where the object's points go.

    keypoints.py  tracked points on the body               lifting.py  tracks to 3D, as rigid as possible
    control.py    what rides on what                       pose.py     the whole body in every frame
    late.py       tracks that begin after frame 0          views.py    further cameras
"""
