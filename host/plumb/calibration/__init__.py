"""Calibration of a board's sensors on its own readings: poses, turns, and the check that all is well."""
