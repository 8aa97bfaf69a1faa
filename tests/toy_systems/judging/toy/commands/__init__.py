"""Commands of `toy`."""
