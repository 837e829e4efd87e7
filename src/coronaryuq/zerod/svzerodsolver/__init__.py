"""svZeroDSolver: run it, read and write its tables, choose between it and the solver here."""
