"""The virtual board in process: the whole flash image on the simulated STM32F103, over its UART or over CAN.

Simulated time passes only while the host waits for an answer, so that two runs give the same bytes.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from plumb.boards.contract import Answer, RawCounts, Setpoints
from plumb.boards.link import LinkBoard
from plumb.boards.virtual_machine import START_US, open_machine
from plumb.flash.image import find_image
from plumb.link.paced import PacedRun
from plumb.link.session import Session
from plumb.spec import images

if TYPE_CHECKING:
    from plumb.contract.parameters import Changes, ControlParams


class VirtualBoard(LinkBoard):
    """The virtual board. machine: the simulated part, for access to its pins. link: serial or can. image, image_bytes:
    the file of the flash image and its contents."""

    def __init__(self, image: Path | None = None, link: str = "serial") -> None:
        self._link, self._named = link, image is not None
        self._power("the image of the checkout" if image is None else str(image), image)
        super().__init__("virtual", self._connect())

    def _power(self, running: str, image: Path | None) -> None:
        self.image = find_image(image)
        self.machine = open_machine(self.image)
        self.image_bytes = self.image.read_bytes()
        self.machine.uart.name = f"the virtual board with {running}"

    def hold(self, system: str) -> Session:
        """Without a named image, a system that `all` leaves out gets its own, and the next one `all` again."""
        if not self._named and system not in self.session.require_match().systems:
            own = images.running(system)
            self.session.close()
            self._power(f"the image {own or images.ALL} of the checkout", own)
            self.session = self._connect()
        return self.session

    def _upload(self, params: ControlParams) -> None:
        self.hold(params.system)
        super()._upload(params)

    def _connect(self) -> Session:
        if self._link != "can":
            return Session.open(self.machine.uart)
        from plumb.boards.virtual_can import MachineBus

        return Session.over(MachineBus(self.machine, self.machine.uart.name))

    def run_paced(self, params: ControlParams, changes: Changes, raw: RawCounts, setpoint: Setpoints) -> Answer:
        """Its time stands still while the host thinks: a commit meets the gap between two steps."""
        self._upload(params)
        answer = PacedRun(self.session, params.system, changes, raw, setpoint).run()
        return Answer(answer.digests, None, len(answer.digests) if answer.why else None, answer.why)

    def restart(self) -> Session:
        """Pull the reset pin and connect again: the board then runs with its saved parameters."""
        self.session.close()
        self.machine.reset()
        self.machine.advance_us(START_US)
        return self.reconnect()

    def reconnect(self) -> Session:
        """Connect again, after a reset by other means."""
        self.machine.uart.reset_input_buffer()
        self.session = self._connect()
        return self.session
