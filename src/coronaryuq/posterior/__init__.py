"""The posterior of the outlet resistances."""
