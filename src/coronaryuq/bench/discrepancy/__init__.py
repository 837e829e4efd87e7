"""The benchmark `discrepancy`: effects hidden in synthetic data."""
