"""Simulation and model diagnosis of the Inductrack maglev cradle of Kim and Ge (2012)."""
