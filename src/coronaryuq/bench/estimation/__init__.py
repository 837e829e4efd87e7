"""The benchmarks `table` and `coverage`: the estimators' intervals."""
