"""Pitch and roll of a smartphone, its samples over UDP."""
