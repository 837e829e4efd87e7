"""The report: one HTML page from result files alone."""
