"""Optional models, each replaceable by a file or by the default that needs none. Weights are the user's to bring.

    endpoint.py   an OpenAI-compatible vision-language server       language.py   materials asked of it (paper, section 3.1)
    folders.py    where weights lie, and what is missing there      catalogue.py  which models there are, with their licences
    depth.py      metric depth of frame 0                           masks.py      a mask from words, followed through the clip
    points.py     point tracks                                      objects.py    what is in the first frame, with material and mask
"""
