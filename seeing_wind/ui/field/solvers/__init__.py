"""Blender's own solvers in the field: matter of density rho accelerates by f / rho.

calibration    particles, hair, cloth, rigid bodies: their effector weights
in_wind        cloth and particles in moving air
physics_nodes  Blender 5.2's physics nodes: a companion object that feeds them
"""
