"""Judging of `turntable`: plots, figures, limits; the gyro alone as the baseline."""
