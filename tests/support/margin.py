"""The sum of the worst parts from the host's last KEEPALIVE to neutral outputs, computed from the sources.

Oscillators are the one thing that the sources cannot say: datasheet DS5319 of the STM32F103x8, table 24 (internal
oscillator, -2 to +2.5 % over temperature), and 100 ppm for any crystal, its ageing and its temperature.
"""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from plumb.bench.bus_load import BITRATES_KBIT, LINE_BITS, WORST_BITS
from plumb.link.endpoint_names import DEFAULT_BAUD

ROOT = Path(__file__).resolve().parents[2]
CRYSTAL, INTERNAL = "crystal", "internal oscillator"
SLOW = {CRYSTAL: 100e-6, INTERNAL: 0.025}
"""How much longer the board's own times may last, by what it runs on."""


class Part(NamedTuple):
    """name: as in the table. us: its longest time. from_clock: the board counts it, and a slow clock stretches it."""

    name: str
    us: float
    from_clock: bool = True


@lru_cache(maxsize=1)
def constants() -> dict[str, int]:
    """Every `#define NAME number` of the headers that the sum needs, and of sums of two such names."""
    found: dict[str, int] = {}
    for header in ("firmware/core/esc.h", "firmware/link/arming.h"):
        text = (ROOT / header).read_text()
        for name, number in re.findall(r"(?m)^#define (\w+) +(\d+)U?\b", text):
            found[name] = int(number)
        for name, one, other in re.findall(r"(?m)^#define (\w+) +\((\w+) \+ (\w+)\)", text):
            found[name] = found[one] + found[other]
    return found


def line_us(clock: str) -> float:
    """The longest KEEPALIVE on its way in. On the internal oscillator CAN is off."""
    uart_us = LINE_BITS * 1e6 / DEFAULT_BAUD
    return uart_us if clock == INTERNAL else max(uart_us, WORST_BITS * 1e3 / min(BITRATES_KBIT))


def parts(clock: str, frame_us: int) -> list[Part]:
    """In the order in which they follow each other; frame_us: esc_period_us."""
    c = constants()
    known = [
        Part("the last KEEPALIVE on the line", line_us(clock), from_clock=False),
        Part("the turn of the loop that takes it in, until its time is stamped", c["ARMING_TURN_US"]),
        Part("silence allowed", c["ARMING_SILENCE_US"]),
        Part("the turn that finds it over, until neutral is written", c["ARMING_TURN_US"]),
        Part("the pulses of the frame that runs", min(frame_us, c["ESC_FRAME_ENDED_HALFUS"] / 2)),
    ]
    slow_us = SLOW[clock] * sum(part.us for part in known if part.from_clock)
    return [*known, Part("a slow clock stretches what the board counts", slow_us, from_clock=False)]


def sum_us(clock: str, frame_us: int) -> float:
    return sum(part.us for part in parts(clock, frame_us))
