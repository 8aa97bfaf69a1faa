"""The host's end of the simulated CAN bus: a python-can bus in this process (MachineBus), and a coupling to any other
python-can bus (Joint).

In process, reading advances simulated time as far as needed, by the time-out at most; sending takes no time: the frame
waits until the simulated bus is free.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence

import can
from can.typechecking import CanFilters

from plumb.f103.attached.canwire import WireFrame
from plumb.f103.core.timeline import TICKS_PER_S
from plumb.f103.machine import Machine
from plumb.spec.protocol import FRAME_DLC, Frame, check, protocol

LOOK_AHEAD = 6
"""Number of frames for which a read waits while the board goes on sending."""
_LONGEST_WAIT_S = 0.5
SEND_PATIENCE_S = 0.02
"""A bus that accepts no frame for this long has failed."""


class MachineBus(can.BusABC):
    """Stands for all other nodes on the bus of a simulated board. clock(): simulated seconds."""

    def __init__(
        self, machine: Machine, name: str = "the virtual board", can_filters: CanFilters | None = None
    ) -> None:
        self.machine = machine
        self.wire = machine.can.wire
        self.rejected = 0
        self.channel_info = f"CAN of {name}"
        self._known = protocol().by_identifier
        self._frames: deque[WireFrame] = deque()
        super().__init__(name, can_filters=can_filters)

    def clock(self) -> float:
        return self.machine.now / TICKS_PER_S

    def _wait(self, timeout_s: float) -> None:
        machine, wire = self.machine, self.wire
        deadline = machine.now + math.ceil(timeout_s * TICKS_PER_S)  # rounded up: the shortest wait must pass
        self._frames.extend(wire.pop_frames())
        while not self._frames and machine.now < deadline:
            machine.run_until_sending(deadline)
            self._frames.extend(wire.pop_frames())
        while wire.board_sends and len(self._frames) < LOOK_AHEAD and machine.now < deadline:
            machine.run_until_sending(deadline)
            self._frames.extend(wire.pop_frames())

    def read_frames(self, timeout_s: float = 0.0) -> list[Frame]:
        """Frames of the protocol with a right CRC; advances up to timeout_s for the first frame."""
        self._wait(timeout_s)
        frames = []
        for frame in self._frames:
            if not frame.extended and not frame.remote and frame.identifier in self._known:
                if check(frame.identifier, frame.data):
                    frames.append((frame.identifier, frame.data))
                else:
                    self.rejected += 1
        self._frames.clear()
        return frames

    def write_frames(self, frames: Sequence[Frame]) -> None:
        for identifier, data in frames:
            self.wire.send(WireFrame(identifier, data))

    # ---- python-can ----

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._frames:
            self._wait(_LONGEST_WAIT_S if timeout is None else timeout)
            if not self._frames:
                return None, False
        return message_of(self._frames.popleft(), self.clock()), False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.wire.send(frame_of(msg))


def message_of(frame: WireFrame, timestamp_s: float) -> can.Message:
    return can.Message(
        timestamp=timestamp_s,
        arbitration_id=frame.identifier,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        dlc=len(frame.data),
        data=None if frame.remote else frame.data,
        is_rx=True,
    )


def frame_of(message: can.Message) -> WireFrame:
    data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
    return WireFrame(message.arbitration_id, data, bool(message.is_extended_id), bool(message.is_remote_frame))


class Joint:
    """Couples a machine's CAN bus with any python-can bus; never blocks.

    kbit: bit rate at the machine's end; a bus with an attribute `kbit` (the rate that its host has set) overrides it.
    """

    def __init__(self, machine: Machine, bus: can.BusABC, kbit: int) -> None:
        self.wire = machine.can.wire
        self.bus = bus
        self.wire.kbit = kbit

    def move(self) -> None:
        """Forward the frames that have arrived, in both directions."""
        while (message := self.bus.recv(0)) is not None:
            self.wire.kbit = getattr(self.bus, "kbit", None) or self.wire.kbit  # may have changed before this frame
            if not message.is_error_frame and not message.is_fd and message.dlc <= FRAME_DLC:
                self.wire.send(frame_of(message))
        for frame in self.wire.pop_frames():
            self.bus.send(message_of(frame, time.time()), timeout=SEND_PATIENCE_S)
