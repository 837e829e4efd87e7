"""Stage two: the posterior of the outlet resistances."""
