"""Judging of `attitude`: plots, figures, limits; recordings as inputs, comparison with published algorithms."""
