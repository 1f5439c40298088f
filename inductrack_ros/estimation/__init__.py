"""Fits of the model to measured runs: initial states, parameters, noise."""
