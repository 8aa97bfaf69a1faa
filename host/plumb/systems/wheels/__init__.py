"""A two-wheeled vehicle that steers."""
