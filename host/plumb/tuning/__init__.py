"""Quantisation of tunings: engineering units to the integers of the firmware, and back."""
