"""The benchmark `flow3d`: flows with exact solutions, the FDA nozzle, other solvers."""
