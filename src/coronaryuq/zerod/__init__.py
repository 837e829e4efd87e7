"""0D models: svZeroDSolver networks, many parameter sets at a time."""
