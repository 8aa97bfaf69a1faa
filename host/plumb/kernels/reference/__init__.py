"""Kernels in float64, as the papers print them."""
