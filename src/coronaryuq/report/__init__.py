"""The report: one HTML page, made from result files only."""
