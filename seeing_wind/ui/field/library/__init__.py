"""Recovered winds as assets: the winds that come with the extension, and duplicated field objects.

shelf      the files, their contents, and appending a wind from them
operators  Add Wind, Add Wind Library
copies     gives duplicated field objects their own texture, and winds without arrows their arrows
arrows     the arrows of a wind from the library
panel      the panel *Wind Library*
"""
