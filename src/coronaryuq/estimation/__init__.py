"""Multi-fidelity estimates of the quantities of interest, with calibrated intervals."""
