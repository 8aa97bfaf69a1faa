"""A low-pass of one count, for tests."""
