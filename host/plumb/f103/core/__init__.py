"""The Cortex-M3 core, simulated time, and the peripheral bus."""
