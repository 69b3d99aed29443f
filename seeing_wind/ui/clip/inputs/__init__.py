"""What Blender's scene knows of a clip, written as the files that the engine reads.

clip_files    the files of a clip, and which of them are one film
clips         the movie clip of the settings: its path, and which of its frames stands at which frame of the scene
pace          clip frames that last more or less than a frame of the scene
scene_inputs  which files the settings call for, each with its option, its stamp and its writer
mask          a Blender mask or plane track as a PNG
held          a box or a painted part of a mesh, at which the object is held, as a PNG
tracks        tracks and plane tracks as an NPZ
camera        a camera solve or the scene's camera as JSON
depth         a proxy mesh as a depth map
lens          from what a lens showed back to what a pinhole would have

`clip_files`, `clips` and `pace` need no NumPy.
"""
