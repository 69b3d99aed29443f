"""A clip as arrays: its frames, its camera, and what is wrong with either.

    frames.py   RGB frames of a video or a folder     stored.py          frames kept on disk instead of in memory
    images.py   one image from a file
    camera.py   intrinsics, poses, distance           transforms.py      the camera file of nerfstudio and instant-ngp
    lens.py     lens distortion                       shake.py           a hand-held camera's turns
    stillness.py  whether the camera stands still
    depth.py    depth in frame 0                      defects.py         black frames, cuts, blur, an object that leaves
    filmed/     faults of the filming: interlacing, slow motion, focus, rolling shutter, ropes
    opencv_threads.py  OpenCV on one thread           video.py           writing MP4
"""
