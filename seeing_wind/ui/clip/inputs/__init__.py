"""Data of Blender's scene about a clip, written as the files that the engine reads.

clip_files    the files of a clip, and whether two paths lead to the same film
clips         the movie clip of the settings: its path, and which scene frame shows which of its frames
pace          clip frames that last more or less than one scene frame
scene_inputs  the files that the settings require, each with its option, stamp and writer
mask          a Blender mask or plane track as a PNG
held          the held place, from a box or the painted part of a mesh, as a PNG
tracks        tracks and plane tracks as an NPZ
camera        a camera solve or the scene's camera as JSON
depth         a proxy mesh as a depth map
lens          undistorts pixels: from the clip's lens to a pinhole camera

`clip_files`, `clips` and `pace` need no NumPy.
"""
