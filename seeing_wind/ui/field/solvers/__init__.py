"""Blender's own solvers in the field: matter of density rho accelerates by f / rho.

calibration    all solvers of an object, one after the other
matter         what a calibration needs, and the weight of a field
particles      particles and hair
cloth          cloth
rigid_body     rigid bodies
apart          forces and winds, which one weight cannot suit together
in_wind        all of them in moving air
surface        the faces that air pushes
physics_nodes  Blender 5.2's physics nodes: a companion object that feeds them
"""
