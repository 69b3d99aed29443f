"""The object's shape in frame 0.

    relief.py      front and back of the body           block.py    plates and posts whose sides are seen
    inflate.py     rounded bodies behind their front    surface.py  closed mesh for display
    parts.py       a stem, what it carries, its leaves  on_stem.py  particles of a body on a stem
    particles.py   particles of all other bodies        columns.py  columns of particles along the line of sight
    pins.py        the part of a body that is held      visibility.py  the part of a moving mesh that a camera sees
"""
