"""Kernels in integers, bit for bit as the firmware computes them."""
