"""Other methods on the cases of the benchmark `discrepancy`, through one adapter."""
