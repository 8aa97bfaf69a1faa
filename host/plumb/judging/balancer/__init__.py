"""Judging of `balancer`: plots, figures, limits, margins of its loops."""
