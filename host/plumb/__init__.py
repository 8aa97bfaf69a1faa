"""plumb: attitude estimation and control in integers, the same answer bit for bit from Python to silicon."""

__version__ = "0.1.0"
