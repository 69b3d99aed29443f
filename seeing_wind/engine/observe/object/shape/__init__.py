"""What the object is in frame 0.

    relief.py      front and back of the body           block.py    plates and posts whose sides are seen
    inflate.py     rounded bodies behind their front    surface.py  closed mesh for display
    parts.py       a stem, what it carries, its leaves  on_stem.py  material points of such a body
    particles.py   material points of the others        columns.py  columns of them along the line of sight
    pins.py        the part of a body that is held      visibility.py  the part of a moving mesh that a camera sees
"""
