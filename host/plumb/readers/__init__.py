"""Readers of logs, frame files and recordings, and their replay on a board."""
