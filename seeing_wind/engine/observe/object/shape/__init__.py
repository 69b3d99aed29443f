"""What the object is in frame 0.

    relief.py      front and back of the body           block.py    plates and posts whose sides are seen
    inflate.py     rounded bodies behind their front    surface.py  closed mesh for display
    particles.py   material points                      pins.py     the part of a body that is held
    visibility.py  the part of a moving mesh that a camera sees
"""
