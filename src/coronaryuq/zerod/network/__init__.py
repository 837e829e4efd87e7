"""0D networks: svZeroDSolver's JSON, its blocks, unknowns and parameters."""
