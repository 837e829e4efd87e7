"""The model whose parameters are inferred: flows, likelihood, emulator, target fractions."""
