"""Tables of a case: outlets, territories, clinical targets."""
