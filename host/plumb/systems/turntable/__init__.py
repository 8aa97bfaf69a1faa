"""Attitude from a gyro and an angular-acceleration sensor."""
