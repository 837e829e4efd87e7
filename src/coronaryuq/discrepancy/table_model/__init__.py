"""The search on paired tables of simulated and measured outputs."""
