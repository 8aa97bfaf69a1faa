"""Published figures of every system, and its plots."""
