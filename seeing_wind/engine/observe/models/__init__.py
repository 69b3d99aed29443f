"""Optional models, each replaceable by a file or by a default that needs no weights. Users provide the weights.

    endpoint.py   an OpenAI-compatible vision-language server       language.py   materials estimated by it (paper, section 3.1)
    folders.py    finding and loading weights                       catalogue.py  the known models, with their licences
    depth.py      metric depth of frame 0                           masks.py      a mask from words, followed through the clip
    points.py     point tracks                                      objects.py    the objects of the first frame, with material and mask
    segment_anything.py  outlines in single frames, which count as evidence beside the engine's own
"""
