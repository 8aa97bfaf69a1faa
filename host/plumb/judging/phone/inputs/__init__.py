"""Samples of a phone: datagrams of apps, over UDP or from a file, resampled to steps of a constant period."""
