"""Boards whose C core is built for this machine: the core alone, the main loop in memory, and plants in C."""
