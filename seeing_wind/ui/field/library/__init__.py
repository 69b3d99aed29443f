"""Recovered winds that come with the extension, as assets.

shelf      the files, what is in them, and taking a wind out of them
operators  Add Wind, Add Wind Library
panel      the panel *Wind Library*
"""
