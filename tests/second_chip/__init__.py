"""A second, small model of the STM32F103, for tests alone.

It runs the same flash image as plumb's own virtual board and shares no code with it: written from the reference manual
(RM0008), the flash programming manual (PM0075), the Armv7-M architecture manual and the vendor's register description.
What the firmware does on both is not an accident of one of them. It knows only what this firmware uses; any other
register, and any access that is not a whole word, raises an error.
"""

from second_chip.chip import Chip
from second_chip.ends import CanEnd, UartEnd

__all__ = ["CanEnd", "Chip", "UartEnd"]
