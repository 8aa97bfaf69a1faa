"""The Cortex-M3 and the chip's time: CPU, interrupts, system control, debug, the peripheral bus."""
