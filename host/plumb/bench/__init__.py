"""What the code costs: instructions, cycles, bytes, and the load of a bus."""
