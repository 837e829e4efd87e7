"""Names of a network's uncertain parameters with `uncertainty: full`: how they begin tells what they stand for."""

LUMEN = "lumen_"
"""Coordinates of the lumen; with the artery and a number or an end."""
HEART = "heart_"
"""Latent coordinates of the tuned heart, numbered."""
UNMEASURED = "unmeasured_"
"""Resistance of an artery's beds without measured flow; with the artery."""
