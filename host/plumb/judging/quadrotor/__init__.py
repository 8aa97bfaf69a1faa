"""Judging of `quadrotor`."""
