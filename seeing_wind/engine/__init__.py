"""The engine: from a clip to a force field to a re-simulation. Importing this package imports nothing heavy."""

__version__ = "0.1.0"
