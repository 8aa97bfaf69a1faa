"""Analyses of recordings and runs: identification of sensors, filters and loops; comparison with published
algorithms."""
