"""Selection of the missing effect: stepwise among candidates, and abstention."""
