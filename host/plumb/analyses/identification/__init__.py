"""Identify what a recording or a test shows: noise of the sensors, variances of the filter, dynamics of the loop."""
