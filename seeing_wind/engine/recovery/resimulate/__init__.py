"""Meshes in, bodies out: what a user inserts, pins and weighs, moved by a recovered field."""

from .mesh import load_mesh
from .simulate import Simulated, simulate_bodies

__all__ = ["Simulated", "load_mesh", "simulate_bodies"]
