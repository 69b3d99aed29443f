"""The engine's own Python: where it is, and how it is made.

environment  where it is
install      Install Engine: the programs that make it, as one job
choices      what the user has chosen in the preferences
preferences  the preferences themselves, as Blender shows them
standalone   a Python of the engine's own, where the system has none
fetch_python the program that downloads and unpacks it
operators    Install Engine, Fetch Python, Check Engine, Open Preferences
"""
