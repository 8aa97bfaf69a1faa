"""Models of parts wired to the chip: sensors on I2C and SPI, the CAN bus."""
