"""A two-wheel self-balancing vehicle (Zhang, He 2013)."""
