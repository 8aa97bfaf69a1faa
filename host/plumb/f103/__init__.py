"""A simulated STM32F103 in Python on Unicorn that runs the unmodified flash image of any program.

    from plumb.f103 import Machine

    machine = Machine(Path("firmware.bin"))    # .bin, .hex or .elf
    machine.advance_us(10_000)
    machine.uart.read(100), machine.pin("PC13"), machine.pwm("PB6")

It models the chip and the parts that can be wired to it, and knows nothing of the program.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plumb.f103.core.bus import SimulationError
    from plumb.f103.machine import FaultStop, Machine

__all__ = ["FaultStop", "Machine", "SimulationError"]


def __getattr__(name: str) -> object:
    """`from plumb.f103 import Machine` without making every import of this package need unicorn."""
    if name in __all__:
        from plumb.f103 import machine
        from plumb.f103.core import bus

        return getattr(bus if name == "SimulationError" else machine, name)
    raise AttributeError(name)


def __dir__() -> list[str]:
    """What the package offers, for completion, before it is imported."""
    return sorted({*globals(), *__all__})
