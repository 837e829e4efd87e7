"""What a campaign asks of the estimators: tables, allocation, convergence, diagnostics."""
