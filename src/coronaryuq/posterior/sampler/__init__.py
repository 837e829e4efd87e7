"""DREAM: chains, proposals, convergence."""
