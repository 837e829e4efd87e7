"""Predictions of the measurements by the 0D model, many parameter sets at a time."""
