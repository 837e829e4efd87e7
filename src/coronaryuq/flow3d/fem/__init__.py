"""Finite elements: the incompressible Navier-Stokes equations, one time step at a time."""
