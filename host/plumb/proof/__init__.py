"""Comparing boards with the model: runs, golden vectors, accuracy, figures, faults, reports."""
