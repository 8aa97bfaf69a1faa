"""The CAN bus of the simulated board: arbitration, duration of frames, and fault injection.

It has two nodes: the board's controller, and the host, which stands for all other nodes. A frame takes its exact number
of bits, stuffing included; of two waiting frames the one with the lower identifier goes first (ISO 11898-1). The host's
node never fails by itself: it acknowledges, and repeats frames that the board destroyed.

Not modelled: suspend transmission of error-passive nodes, overload frames, arbitration within a frame under way.
"""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, NamedTuple, Protocol

from plumb.f103.core.timeline import TICKS_PER_S

if TYPE_CHECKING:
    from plumb.f103.core.mcu import Mcu
    from plumb.f103.core.probe import Probe

STUFF, FORM, ACK, BIT_RECESSIVE, BIT_DOMINANT, CRC = 1, 2, 3, 4, 5, 6
"""Kinds of error, with the values of the controller's last error code."""
RATE_TOLERANCE = 0.005
ERROR_BITS = 23
"""Error flags of both sides, delimiter and intermission, after the erroneous bit."""
AFTER_STUFFING = 13
"""CRC delimiter, acknowledgement and its delimiter, end of frame, intermission."""
LONGEST_QUEUE = 4096


class WireFrame(NamedTuple):
    """A frame. data: up to eight bytes; in a remote frame, as many bytes as it requests."""

    identifier: int
    data: bytes
    extended: bool = False
    remote: bool = False

    @property
    def urgency(self) -> tuple[int, int, int]:
        """Order of arbitration, the lowest wins: base identifier, standard before extended, data before remote."""
        base = self.identifier >> 18 if self.extended else self.identifier
        return base, int(self.extended), self.identifier << 1 | self.remote


def _crc15_of(byte: int) -> int:
    crc = byte << 7
    for _ in range(8):
        crc = (crc << 1 ^ (0x4599 if crc & 0x4000 else 0)) & 0x7FFF
    return crc


CRC15_TABLE = tuple(_crc15_of(byte) for byte in range(256))


def _unstuffed(frame: WireFrame) -> str:
    """The bits of a frame from its start to the end of its CRC, without stuff bits."""
    if frame.extended:
        head = (frame.identifier >> 18) << 21 | 3 << 19 | (frame.identifier & 0x3FFFF) << 1 | frame.remote
        head, length = head << 6 | len(frame.data), 39
    else:
        head, length = frame.identifier << 7 | frame.remote << 6 | len(frame.data), 19
    if not frame.remote:
        head = head << 8 * len(frame.data) | int.from_bytes(frame.data, "big")
        length += 8 * len(frame.data)
    crc = 0
    for byte in head.to_bytes((length + 7) // 8, "big"):  # zeros in front change nothing: the CRC begins at 0
        crc = (crc << 8 & 0x7FFF) ^ CRC15_TABLE[crc >> 7 ^ byte]
    return format(head << 15 | crc, f"0{length + 15}b")


def frame_bits(frame: WireFrame) -> int:
    """Number of bits of a frame on the wire, stuff bits and intermission included."""
    bits = _unstuffed(frame)
    last, run, stuffed = "", 0, 0
    for bit in bits:
        if bit == last:
            run += 1
            if run == 5:
                stuffed += 1
                last, run = ("0" if bit == "1" else "1"), 1
        else:
            last, run = bit, 1
    return len(bits) + stuffed + AFTER_STUFFING


def frame_levels(frame: WireFrame, acknowledged: bool) -> str:
    """The bits of a frame on the wire, 0 dominant, stuff bits and intermission included."""
    levels, run = "", 0
    for bit in _unstuffed(frame):
        run = run + 1 if levels[-1:] == bit else 1
        levels += bit
        if run == 5:
            levels += "1" if bit == "0" else "0"
            run = 1
    return f"{levels}1{'0' if acknowledged else '1'}{'1' * (AFTER_STUFFING - 2)}"


def error_levels(frame: WireFrame) -> str:
    """The bits of a frame that is destroyed at its end: an error flag, its delimiter and intermission replace the
    rest."""
    stuffed = frame_levels(frame, False)
    return stuffed + "0" * 6 + "1" * (ERROR_BITS - 6)


class CanController(Protocol):
    """The board's node. kbit: its bit rate. listening: it takes part in what is on the bus."""

    @property
    def kbit(self) -> float: ...
    @property
    def listening(self) -> bool: ...
    def offer(self) -> WireFrame | None:
        """The frame that it wants to send first, if any."""

    def bus_changed(self) -> None: ...
    def frame_over(self) -> None: ...
    def sent(self) -> None: ...
    def send_failed(self, kind: int, /) -> None: ...
    def receive(self, frame: WireFrame, /) -> None: ...
    def receive_failed(self, kind: int, /) -> None: ...


class CanWire:
    """The bus. kbit: the host's bit rate. attached: another node is on the bus and acknowledges the board's frames.

    Fault injection: acknowledged = False (the other nodes only listen), fail_sending and fail_receiving (kinds of error
    for the next attempts), babbler (a frame that a broken node sends without end), dominant (a short: no recessive
    bit).
    """

    def __init__(self, machine: Mcu, node: CanController) -> None:
        self.machine = machine
        self.node = node
        self.kbit = 500
        self.attached = self.acknowledged = True
        self.fail_sending: deque[int] = deque()
        self.fail_receiving: deque[int] = deque()
        self.babbler: WireFrame | None = None
        self.dominant = False
        self.frames_sent = 0
        self.host_errors = 0
        self._from_host: deque[WireFrame] = deque(maxlen=LONGEST_QUEUE)
        self._to_host: deque[WireFrame] = deque(maxlen=LONGEST_QUEUE)
        self._sender = ""
        self._frame: WireFrame | None = None

    @property
    def board_sends(self) -> bool:
        return self._frame is not None and self._sender == "board"

    # The host's end

    def send(self, frame: WireFrame) -> None:
        """Queue a frame of the host; it goes out when it wins arbitration on a free bus."""
        self._from_host.append(frame)
        self.look()

    def pop_frames(self) -> list[WireFrame]:
        """Frames the host has received since the last call."""
        frames = list(self._to_host)
        self._to_host.clear()
        return frames

    @property
    def waiting(self) -> bool:
        return bool(self._to_host)

    def babble(self, frame: WireFrame | None) -> None:
        """A broken node sends this frame without a pause; None ends it."""
        self.babbler = frame
        self.look()

    def short(self, dominant: bool) -> None:
        """Short the bus to dominant, or remove the short."""
        self.dominant = dominant
        self.node.bus_changed()
        self.look()

    # The bus

    def _bit_ticks(self, kbit: float) -> int:
        return round(TICKS_PER_S / (1000 * kbit))

    def _rates_agree(self) -> bool:
        return abs(self.node.kbit - self.kbit) <= RATE_TOLERANCE * self.kbit

    def look(self) -> None:
        """Begin the next frame if the bus is free and a node has one; call after every change."""
        if self._frame is not None or not self.machine.powered:
            return
        offers = []
        mine = self.node.offer()
        if mine is not None:
            offers.append((mine.urgency, 2, "board", mine))
        if self.babbler is not None:
            offers.append((self.babbler.urgency, 0, "babbler", self.babbler))
        if self._from_host:
            offers.append((self._from_host[0].urgency, 1, "host", self._from_host[0]))
        if not offers:
            return
        _, _, self._sender, self._frame = min(offers)
        bits = frame_bits(self._frame) + (ERROR_BITS if self._goes_wrong() else 0)
        kbit = self.node.kbit if self._sender == "board" else self.kbit
        if self.machine.probe is not None:
            self._show(self.machine.probe, self._frame, self._bit_ticks(kbit))
        self.machine.timeline.at("can", self.machine.now + bits * self._bit_ticks(kbit), self._complete)

    def _show(self, probe: Probe, frame: WireFrame, bit_ticks: int) -> None:
        heard = (self.attached and self.acknowledged) if self._sender == "board" else self.node.listening
        levels = error_levels(frame) if self._goes_wrong() else frame_levels(frame, heard)
        probe.can(self.machine.now, bit_ticks, levels, self._sender == "board")

    def _goes_wrong(self) -> bool:
        return not self._rates_agree() or bool(self.fail_sending if self._sender == "board" else self.fail_receiving)

    def _complete(self, _time: int) -> None:
        frame, sender = self._frame, self._sender
        self._frame = None
        assert frame is not None
        if sender == "board":
            self._complete_board(frame)
        else:
            self._complete_other(frame, sender)
        self.node.frame_over()
        self.look()

    def _complete_board(self, frame: WireFrame) -> None:
        if self.dominant:
            self.node.send_failed(BIT_RECESSIVE)
        elif self.fail_sending:
            self.node.send_failed(self.fail_sending.popleft())
        elif self.attached and not self._rates_agree():
            self.node.send_failed(BIT_RECESSIVE)
        elif not (self.attached and self.acknowledged):
            self.node.send_failed(ACK)
        else:
            self.node.sent()
            self.frames_sent += 1
            self._to_host.append(frame)
            self.machine.host_waits_no_more()

    def _complete_other(self, frame: WireFrame, sender: str) -> None:
        node = self.node
        if self.dominant or (node.listening and not self._rates_agree()):
            self.host_errors += 1
            node.receive_failed(STUFF)
        elif node.listening and self.fail_receiving:
            self.host_errors += 1
            node.receive_failed(self.fail_receiving.popleft())
            return  # destroyed by the board's error flag: the sender tries again
        elif node.listening:
            node.receive(frame)
        if sender == "host":
            self._from_host.popleft()

    def board_lost(self) -> None:
        """The board was reset: its frame on the wire ends without effect, and the bus is free for the others."""
        if self.board_sends:
            self._forget()
        self.look()

    def power_off(self) -> None:
        self._forget()
        self._from_host.clear()

    def _forget(self) -> None:
        self._frame = None
        self.machine.timeline.cancel("can")
