"""A clip as arrays: its frames, its camera, and what is wrong with either.

    frames.py   RGB frames of a video or a folder     defects.py         black frames, cuts, blur, an object that leaves
    camera.py   intrinsics, poses, distance           transforms.py      the camera file of nerfstudio and instant-ngp
    lens.py     lens distortion                       shake.py           a hand-held camera's turns
    depth.py    depth in frame 0                      opencv_threads.py  OpenCV on one thread
"""
