"""The benchmark `discrepancy`: effects hidden on purpose."""
