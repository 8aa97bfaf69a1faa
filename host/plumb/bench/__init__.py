"""Cost of the code: instructions, cycles, bytes, stack; and load of the buses."""
