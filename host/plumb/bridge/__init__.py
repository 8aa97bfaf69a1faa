"""The sensor bridge: the simulated sensor board, and the frames of two buses forwarded and counted."""
