"""Commands of `phone`."""
