"""Blender's own solvers in the field: matter of density rho accelerates by f / rho.

calibration    all solvers of an object, one after the other
matter         what a calibration needs, and the weight of a field
particles      particles and hair
cloth          cloth
rigid_body     rigid bodies
apart          keeps forces and winds apart, as no weight suits both
in_wind        all these solvers in moving air
surface        the faces that the air pushes
physics_nodes  Blender 5.2's physics nodes: a companion object that feeds them
"""
