"""Samples of a phone: what apps send, over UDP or from a file, as steps of a steady period."""
