"""Boot an image for the STM32F103 on the simulated chip; print what its UART sends in 20 ms, and the level of a pin.

python examples/boot_any_image.py firmware.bin PC13 [BAUD]     BAUD: at which the image sends, 921600 by default
"""

import sys
from pathlib import Path

from plumb.f103 import FaultStop, Machine

if len(sys.argv) < 3:
    sys.exit(__doc__)
machine = Machine(Path(sys.argv[1]))  # .bin, .hex or .elf; the power has just come on
machine.uart.baudrate = int(sys.argv[3]) if len(sys.argv) > 3 else 921600
try:
    machine.advance_us(20_000)
except FaultStop as stop:
    print(stop)  # what, when, where (an .elf names function and line) and why
if not machine.usart.baud:
    print("the program never set up USART1")
elif abs(machine.usart.baud / machine.uart.baudrate - 1) > 0.05:
    print(f"USART1 is set to {machine.usart.baud:.0f} baud, what came is read at {machine.uart.baudrate}: give BAUD")
print(machine.uart.read(machine.uart.in_waiting))
print(sys.argv[2], machine.pin(sys.argv[2]))  # True, False, or None where it floats
