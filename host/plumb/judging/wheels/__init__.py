"""Judging of `wheels`: plots, figures, limits, margins of its loops."""
