"""Formats in which other tools write the frames of a bus, a file for each family."""
