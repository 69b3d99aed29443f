"""How the object's points move.

    keypoints.py  tracked points on the body               lifting.py  tracks lifted to 3D, as rigid as possible
    control.py    points attached to other points          pose.py     the pose of the whole body in every frame
    late.py       tracks that begin after frame 0          views.py    further cameras
"""
