"""Kernels in integers and in float64, one step of an algorithm each."""
