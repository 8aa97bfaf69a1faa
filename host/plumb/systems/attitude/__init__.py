"""Attitude in three dimensions from a gyro and an accelerometer."""
