"""A receiver's line on which anything may come, with what the transmitter truly said: drawn from a seed.

A good frame has a serial in its roll, so that what the board has can be traced to it. A marked frame
has another throttle than any good one has: it comes in the payload of another frame alone, where it must not count.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace

from plumb.spec import crsf

BYTE_US = 1e7 / crsf.BAUD
OFF, ON = 172, 1811
"""Positions of the switch."""
LOWEST, HIGHEST, MARKED = 172, 1700, 1811
"""Throttles of good frames, below the highest, and of the frames that must not count."""
SERIALS = range(173, 1811)
"""Values of roll: each is another word of the stick, and none is the middle."""
OTHERS = (0x02, 0x08, 0x0A, 0x1E, 0x21, 0x29, 0x2B, 0x2D, 0x7A, 0x7B, 0x7C)
"""Types of frames that do not count."""
EVERY_US = (2000, 4000, 6667, 10_000, 20_000, 40_000)
"""Between two frames of a receiver."""


@dataclass(frozen=True)
class Said:
    """A good frame of channels. serial: its roll; end_us: when its last byte has passed; switch: channel 5."""

    bytes_: bytes
    serial: int
    end_us: float
    switch: int
    throttle: int


@dataclass
class Line:
    """bytes_, after_us: what has passed, and when; said, qualities: the good frames of channels and of statistics (end,
    quality); disturbed: the times at which something else has passed (begin, end)."""

    chance: random.Random
    now_us: float = 0.0
    bytes_: bytearray = field(default_factory=bytearray)
    after_us: list[int] = field(default_factory=list)
    said: list[Said] = field(default_factory=list)
    qualities: list[tuple[float, int]] = field(default_factory=list)
    disturbed: list[tuple[float, float]] = field(default_factory=list)
    wholes: set[int] = field(default_factory=set)
    """Where in the bytes a whole frame begins, and what is inside one of another type."""

    def passes(self, data: bytes) -> float:
        """These bytes pass now, without a pause; when the last one has."""
        for byte in data:
            self.now_us += BYTE_US
            self.bytes_.append(byte)
            self.after_us.append(round(self.now_us))
        return self.now_us

    def pause(self, time_us: float) -> None:
        self.now_us += time_us

    def disturb(self, data: bytes) -> None:
        begin_us = self.now_us
        if is_whole(data):
            self.wholes.update(range(len(self.bytes_), len(self.bytes_) + len(data)))
        self.disturbed.append((begin_us, self.passes(data)))

    def good(self, switch: int, throttle: int) -> None:
        serial = SERIALS[len(self.said) % len(SERIALS)]
        frame = crsf.channels([serial, 992, throttle, 992, switch])
        self.wholes.add(len(self.bytes_))
        self.said.append(Said(frame, serial, self.passes(frame), switch, throttle))

    def repeat(self) -> None:
        """The last good frame once more."""
        last = self.said[-1]
        self.wholes.add(len(self.bytes_))
        self.said.append(replace(last, end_us=self.passes(last.bytes_)))

    def statistics(self, quality: int) -> None:
        self.wholes.add(len(self.bytes_))
        self.qualities.append((self.passes(crsf.statistics(quality)), quality))


def is_whole(data: bytes) -> bool:
    """A frame from the first byte to the last."""
    size_fits = len(data) >= crsf.MIN_BYTES and data[0] == crsf.SYNC and data[1] + 2 == len(data) <= crsf.MAX_BYTES
    return size_fits and crsf.crc8(data[2:-1]) == data[-1]


def coincides(data: bytes, wholes: Collection[int]) -> bool:
    """Elsewhere than there something looks like a frame and has the right CRC, as 1 in 256 of such does: it may hide
    what comes behind it, or count."""
    return any(
        data[at] == crsf.SYNC and is_whole(data[at : at + data[at + 1] + 2])
        for at in range(len(data) - crsf.MIN_BYTES + 1)
        if at not in wholes
    )


def marked(chance: random.Random) -> bytes:
    """A frame that would count where it is no payload."""
    if chance.random() < 0.3:
        return crsf.statistics(chance.choice([0, 100]))
    return crsf.channels([chance.choice(SERIALS), 992, MARKED, 992, chance.choice([OFF, ON])])


def nested(chance: random.Random) -> bytes:
    """A frame of another type, or of another length, with frames in its payload."""
    inner = bytearray(chance.randbytes(chance.randrange(8)))
    while chance.random() < 0.7 and len(inner) < 34:
        inner += marked(chance)
    inner += chance.randbytes(chance.randrange(60 - len(inner)))
    kind = chance.choice((*OTHERS, crsf.STICKS, crsf.STATISTICS))
    return crsf.frame(kind, bytes(inner[:60]) + bytes(3 if len(inner) in (10, 22) else 0)[: 60 - len(inner)])


def damaged(chance: random.Random) -> bytes:
    """A frame with one or three wrong bits, or a burst, which its CRC finds; or with bytes missing."""
    whole = crsf.channels([chance.choice(SERIALS), 992, MARKED, 992, chance.choice([OFF, ON])])
    way = chance.randrange(4)
    if way == 0:
        return whole[: chance.randrange(1, len(whole))]
    if way == 1:
        return whole[chance.randrange(1, len(whole)) :]
    bits = int.from_bytes(whole, "big")
    if way == 2:
        for bit in chance.sample(range(8 * len(whole) - 16), chance.choice([1, 3])):
            bits ^= 1 << bit
    else:
        bits ^= (chance.randrange(128) << 1 | 1) << chance.randrange(8 * len(whole) - 24)
    return bits.to_bytes(len(whole), "big")


def noise(chance: random.Random) -> bytes:
    pool = [crsf.SYNC, 24, 62, 12, crsf.STICKS, crsf.STATISTICS, 0, 255]
    count = chance.randrange(1, 90)
    return bytes(chance.choices(pool, k=count)) if chance.random() < 0.5 else chance.randbytes(count)


def false_length(chance: random.Random) -> bytes:
    """The beginning of a frame whose end lies in what comes next."""
    return bytes([crsf.SYNC, chance.choice((chance.randrange(256), chance.randrange(40, 66)))])


HOSTILE: tuple[Callable[[random.Random], bytes], ...] = (nested, damaged, noise, false_length)


def drawn(seed: int, seconds: float) -> Line:
    """A line of that seed on which nothing has the CRC of a frame by chance."""
    chance = random.Random(seed)
    while True:
        line = _drawn(chance, seconds)
        if not coincides(bytes(line.bytes_), line.wholes):
            return line


def _drawn(chance: random.Random, seconds: float) -> Line:
    """A receiver whose pilot switches and moves his sticks, and anything else on the line between its frames."""
    line = Line(chance)
    switch = OFF
    while line.now_us < seconds * 1e6:
        every_us = chance.choice(EVERY_US)
        hostile = chance.choice((0.0, 0.05, 0.3))
        flickers = chance.random() < 0.2
        if chance.random() < 0.5:
            switch = OFF + ON - switch
        for _ in range(chance.randrange(1, 60)):
            begin_us = line.now_us
            if chance.random() < hostile:
                line.disturb(chance.choice(HOSTILE)(chance))
            position = OFF + ON - switch if flickers and chance.random() < 0.4 else switch
            if line.said and chance.random() < 0.05:
                line.repeat()
            else:
                line.good(position, chance.randrange(LOWEST, HIGHEST))
            if chance.random() < 0.1:
                line.statistics(chance.choice((1, 50, 100)))
            line.pause(max(every_us - (line.now_us - begin_us), 0.0))
        way = chance.random()
        if way < 0.25:
            if chance.random() < 0.5:
                line.disturb(false_length(chance))
                line.good(switch, chance.randrange(LOWEST, HIGHEST))
            line.pause(chance.uniform(5e3, 400e3))
        elif way < 0.4:
            line.statistics(0)
            for _ in range(chance.randrange(30)):
                line.good(chance.choice((OFF, ON)), chance.randrange(LOWEST, HIGHEST))
                line.pause(every_us)
            line.statistics(chance.choice((1, 100)))
    return line
