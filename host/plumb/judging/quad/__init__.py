"""Judging of `quad`: plots, figures, limits, margins of its loop; recordings, demo, the table of bandwidths."""
