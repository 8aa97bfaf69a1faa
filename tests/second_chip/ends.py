"""The far ends of the chip's two links, as the host's session takes them. Waiting lets the chip's time pass."""

from __future__ import annotations

import can

from second_chip.chip import Chip

WAIT_S = 0.0002


class UartEnd:
    """In-process byte stream: read(n), write(data), clock_s()."""

    name = "the second model's UART"

    def __init__(self, chip: Chip) -> None:
        self.chip = chip
        self.clock_s = chip.seconds

    def write(self, data: bytes) -> None:
        self.chip.uart.put(data)

    def read(self, count: int) -> bytes:
        sent = self.chip.uart.sent
        if not sent:
            self.chip.run(WAIT_S)
        data = bytes(sent[:count])
        del sent[:count]
        return data


class CanEnd(can.BusABC):
    """A python-can bus whose clock is the chip's."""

    channel_info = "the second model's CAN bus"

    def __init__(self, chip: Chip) -> None:
        self.chip = chip
        self.clock = chip.seconds
        super().__init__(self.channel_info)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.chip.can.put((msg.arbitration_id, bytes(msg.data)))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """In the chip's time alone: python-can's own goes by this machine's clock, too."""
        sent = self.chip.can.sent
        if not sent and timeout:
            self.chip.run_until(lambda: bool(sent), timeout)
        if not sent:
            return None
        identifier, data = sent.pop(0)
        return can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
