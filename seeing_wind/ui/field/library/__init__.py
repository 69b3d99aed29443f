"""Recovered winds as assets: those that come with the extension, and field objects that are duplicated.

shelf      the files, what is in them, and taking a wind out of them
operators  Add Wind, Add Wind Library
copies     a duplicated field object gets a texture of its own, and what has none its arrows
arrows     the arrows of a wind that was taken out
panel      the panel *Wind Library*
"""
