"""Two hosts of one board on the native port, a frame and an answer at a time: nothing is repeated, no answer is waited
for longer than it may take. What a host of this package does by itself (plumb.link.session) is left to the test."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from enum import IntEnum

from plumb.boards.native.mcu import NativeMcu
from plumb.spec.protocol import Frame, check, protocol
from support.native_board import BUILD

SLICE_US = 1000
ANSWER_MS = 10
"""Lines that take no time: what is asked is answered within this, whatever else waits on the line."""
IDENTITY_MS = 100
"""Identity goes on by a frame every 2 ms when telemetry fills the queue."""


class Link(IntEnum):
    UART = 0
    CAN = 1


class TwoHosts:
    """each_ms: called after every millisecond. on_frame: called with every frame of the board."""

    def __init__(self, each_ms: Callable[[], None], on_frame: Callable[[Link, str, dict[str, int]], None]) -> None:
        self.mcu = NativeMcu(BUILD / "libplumb_board_trapping.so")
        self.wires = self.mcu.wires
        self.protocol = protocol()
        self.received: dict[Link, deque[tuple[str, dict[str, int]]]] = {link: deque(maxlen=400) for link in Link}
        self.accepted = self.refused = 0
        """Lines of the UART answered by CR, and by BEL; keep-alives are not counted."""
        self._asked: deque[bool] = deque()  # lines that are not answered yet: whether they are counted
        self._line = b""
        self._counters: dict[tuple[Link, int], int] = {}
        self._each_ms, self._on_frame = each_ms, on_frame

    @property
    def now_us(self) -> int:
        return self.mcu.now_us

    def power_on(self) -> None:
        self._line = b""
        self._asked.clear()
        self.mcu.power_on()

    # ---- to the board ----

    def sealed(self, link: Link, name: str, *words: int, flags: int = 0, counter: int | None = None) -> Frame:
        message = self.protocol[name]
        key = (link, message.identifier)
        if counter is None:
            counter = self._counters[key] = self._counters.get(key, 0) + 1 & 15
        return message.identifier, message.pack(counter, flags, *words)

    def put(self, link: Link, frame: Frame) -> None:
        if link is Link.CAN:
            assert self.mcu.can_send(*frame)
        else:
            counted = self.protocol.by_identifier[frame[0]].name != "KEEPALIVE"
            self.text(f"t{frame[0]:03X}8{frame[1].hex().upper()}\r".encode(), counted=counted)

    def text(self, data: bytes, *, counted: bool = True) -> None:
        self._asked.extend([counted] * data.count(b"\r"))
        assert self.mcu.uart_send(data) == len(data)

    # ---- from the board ----

    def pass_ms(self, count: int = 1) -> None:
        for _ in range(count):
            self.mcu.run_us(SLICE_US)
            self._listen()
            self._each_ms()

    def _listen(self) -> None:
        for byte in self.mcu.uart_receive():
            if byte == 7:
                assert self._line == b"", "BEL in the middle of a line"
                self.refused += self._asked.popleft()
            elif byte != 13:
                self._line += bytes((byte,))
            else:
                self._on_line(self._line.decode("ascii"))
                self._line = b""
        for frame in self.mcu.can_receive():
            self._note(Link.CAN, frame)

    def _on_line(self, line: str) -> None:
        if line == "" or line[0] in "VN":
            self.accepted += self._asked.popleft()
        else:
            assert line[0] == "t" and len(line) == 21, line
            self._note(Link.UART, (int(line[1:4], 16), bytes.fromhex(line[5:])))

    def _note(self, link: Link, frame: Frame) -> None:
        assert check(*frame), f"{link.name}: a frame of the board is damaged"
        message = self.protocol.by_identifier[frame[0]]
        assert message.sender != "host"
        said = message.decode(frame[1])
        self.received[link].append((message.name, said))
        self._on_frame(link, message.name, said)

    # ---- both ----

    def wait(self, link: Link, found: Callable[[str, dict[str, int]], bool], limit_ms: int) -> dict[str, int] | None:
        """The first frame that is wanted, or None after so long."""
        for _ in range(limit_ms):
            self.pass_ms()
            while self.received[link]:
                name, said = self.received[link].popleft()
                if found(name, said):
                    return {**said, "name": self.protocol[name].identifier}
        return None

    def ask(
        self, link: Link, name: str, *words: int, flags: int = 0, answer: str = "ACK", limit_ms: int = ANSWER_MS
    ) -> tuple[str, dict[str, int]] | None:
        """Name of the answer and what it says: `answer`, or NACK; None when the frame was refused unseen.

        Fails when nothing comes although the frame was let in on the UART, or when something does although it was not.
        """
        frame = self.sealed(link, name, *words, flags=flags)
        identifier, counter = frame[0], frame[1][1] & 15
        self.received[link].clear()
        accepted, refused = self.accepted, self.refused
        self.put(link, frame)
        wanted = self.protocol[answer].identifier

        def is_answer(kind: str, said: dict[str, int]) -> bool:
            if kind in ("ACK", "NACK"):
                return said["request"] == identifier and said["request_counter"] == counter
            return kind == answer and (answer != "IDENTITY" or said["item"] == 0xFFFF)

        said = self.wait(link, is_answer, limit_ms)
        if link is Link.UART:
            assert (self.accepted - accepted, self.refused - refused) == ((0, 1) if said is None else (1, 0))
        if said is None:
            return None
        return (answer if said["name"] == wanted else "NACK"), said
