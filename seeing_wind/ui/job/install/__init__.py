"""The engine's own Python: where it is, and how it is made.

environment  where it is
install      Install Engine: the programs that make it, as one job
choices      what the user has chosen in the preferences
preferences  the preferences themselves, as Blender shows them
operators    Install Engine, Doctor, Open Preferences
"""
