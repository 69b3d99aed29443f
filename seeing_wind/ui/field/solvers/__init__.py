"""Blender's own solvers in the field: matter of density rho accelerates by f / rho.

calibration    particles, hair, cloth, rigid bodies: their effector weights
physics_nodes  Blender 5.2's physics nodes: a companion object that feeds them
"""
