"""Sensors, motors and disturbances as physics: no link, no board."""
