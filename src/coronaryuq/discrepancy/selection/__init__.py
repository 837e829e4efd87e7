"""Which effect is missing: stepwise selection among candidates, and abstention."""
