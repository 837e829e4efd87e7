"""What the model is missing: locate, name, add, verify."""
