"""The flash image: its format, the ROM bootloader, the debug probe."""
