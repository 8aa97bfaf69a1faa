"""Angles of a recording: roll, pitch, rate about the vertical and their standard deviation, for `plumb estimate`."""
