"""Judging of `phone`: plots, figures, limits; samples over UDP and its live run, recordings, comparison."""
