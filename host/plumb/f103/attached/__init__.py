"""What is wired to the chip: sensors on I2C and SPI, the CAN wire, straps."""
