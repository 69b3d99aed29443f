"""The engine's own Python: where it is, and how it is made.

environment  finds it
install      Install Engine: runs the programs that make it, as one job
choices      what the user has chosen in the preferences
preferences  the preferences as Blender displays them
standalone   a Python for the engine alone, if the system has none that fits
fetch_python the program that downloads and unpacks this Python
operators    Install Engine, Fetch Python, Check Engine, Open Preferences
"""
