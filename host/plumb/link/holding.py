"""Whether a session holds the board armed, from the board's frames: one place that knows the arming and its end.

Each arming has a number. The ACK of ARM carries it to the host that armed, and repeats bits of the nonce that this host
sent, so that on a bus no host takes the ACK of another one for its own. Every keep-alive value carries the number; a
host answers the values of its own arming alone, and any frame of the board can show that its arming is over.
"""

from __future__ import annotations

from collections import deque

from plumb.spec.protocol import Frame, Protocol

VALUES_KEPT = 4
"""Keep-alive values that are answered when more of them arrive at once: the others have expired."""
_ARMED_FLAG, _RUN_TAG_SHIFT = 0x10, 4
_ECHO_SHIFT = 16
"""The detail of the ACK of ARM: the number of the arming, and above it the same bits of the nonce as it was sent."""


class Holding:
    """number: of the arming that this session holds; 0: none. over: why the last one ended without an order of this
    session; "" until then, and from the next order on. another: another host has armed the board or begun a run."""

    def __init__(self, protocol: Protocol) -> None:
        self.number, self.over, self.another = 0, "", False
        self._claimed: int | None = None
        self._early: deque[tuple[int, int]] = deque(maxlen=VALUES_KEPT)
        self._value, self._ack = protocol["KEEPALIVE_VALUE"], protocol["ACK"]
        self._execute_id = protocol["EXECUTE"].identifier
        self._step_id, self._status_id = protocol["STEP"].identifier, protocol["STATUS"].identifier
        self._time_id = protocol["TIME"].identifier

    def claim(self, nonce: int) -> None:
        """EXECUTE ARM goes out with this nonce: its ACK begins an arming of this session."""
        self._claimed = nonce >> _ECHO_SHIFT

    def unclaim(self) -> None:
        """No ACK of ARM is waited for any more."""
        self._claimed = None
        self._early.clear()

    def release(self) -> None:
        """An order of this session ends its arming: from here on nothing is answered."""
        self.unclaim()
        self.number, self.over, self.another = 0, "", False

    def follow(self, frames: list[Frame], run_tag: int) -> list[int]:
        """Take frames of the board in the order in which they came; returns the values that are to be answered.

        run_tag: of the run that this session began; 0: it began none."""
        if not self.number and self._claimed is None:
            return []
        values: deque[int] = deque(maxlen=VALUES_KEPT)
        for identifier, data in frames:
            if identifier == self._value.identifier:
                _, _, number, value = self._value.unpack(data)
                if number == self.number:
                    values.append(value)
                elif self._claimed is not None:
                    self._early.append((number, value))
                elif self.number:
                    self._end("another host has armed the board", another=True)
            elif identifier == self._ack.identifier and self._claimed is not None:
                values.extend(self._acknowledged(data))
            elif self.number:
                self._notice_end(identifier, data, run_tag)
        return list(values) if self.number else []

    def _acknowledged(self, data: bytes) -> list[int]:
        """An ACK while one of ARM is waited for; returns the values of this arming that came before it."""
        _, _, request, detail = self._ack.unpack(data)
        if request != self._execute_id or detail >> _ECHO_SHIFT != self._claimed:
            return []
        self.number, self.over, self.another = detail & 0xFFFF, "", False
        values = [value for number, value in self._early if number == self.number]
        self.unclaim()
        return values

    def _notice_end(self, identifier: int, data: bytes, run_tag: int) -> None:
        if identifier in (self._step_id, self._status_id):
            if not data[1] & _ARMED_FLAG:
                self._end("the board is not armed any more")
        elif identifier == self._time_id and run_tag and data[1] >> _RUN_TAG_SHIFT != run_tag:
            another = data[1] >> _RUN_TAG_SHIFT != 0
            self._end("another host has begun a run" if another else "the run on the board is over", another=another)

    def _end(self, why: str, *, another: bool = False) -> None:
        self.release()
        self.over, self.another = why, another
