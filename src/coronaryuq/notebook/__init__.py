"""Functions for notebooks and scripts, available as stable names of `coronaryuq` itself."""
