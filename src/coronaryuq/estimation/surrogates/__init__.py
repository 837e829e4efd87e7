"""Surrogates of the models: control variates, Gaussian processes, autoencoders."""
