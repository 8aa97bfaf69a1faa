"""The virtual board in process: the whole flash image on the simulated STM32F103, spoken to over its UART.

Stepped: simulated time passes only while the host waits for bytes, so that two runs give the same bytes.
"""

from __future__ import annotations

from pathlib import Path

from plumb.boards.link import LinkBoard
from plumb.f103 import START_US, open_machine
from plumb.session import Session


class VirtualBoard(LinkBoard):
    """machine: the simulated part, for who wants to reach its pins."""

    def __init__(self, image: Path | None = None) -> None:
        self.machine = open_machine(image)
        running = "the image of the checkout" if image is None else str(image)
        self.machine.uart.name = f"the virtual board with {running}"
        super().__init__("virtual", Session.open(self.machine.uart))

    def restart(self) -> Session:
        """Pull the reset pin and connect again: what is saved is in force then."""
        self.session.close()
        self.machine.reset()
        self.machine.advance_us(START_US)
        self.session = Session.open(self.machine.uart)
        return self.session
