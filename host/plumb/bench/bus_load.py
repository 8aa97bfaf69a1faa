"""What the links carry: the longest frame on a CAN bus, what an open link always says, steps a second of every system.

`python -m plumb.bench.bus_load` prints it; PROTOCOL.md has the same tables from here. Everything is the worst case:
each frame with as many stuff bits as can be, no step without all its frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from plumb import systems
from plumb.link.endpoint_names import DEFAULT_BAUD
from plumb.link.session import KEEPALIVE_EVERY_S, PERIODIC
from plumb.spec import declarations
from plumb.spec.records import RECORDS
from plumb.systems.contracts import PINS

BITRATES_KBIT = (125, 250, 500, 1000)
QUANTA, PHASE_2, SJW = 18, 2, 2
"""Of a bit; after the sample point; by how many a bit may be stretched."""
PLAIN_BITS = 111
"""ISO 11898-1: a data frame of eight bytes with a standard identifier, intermission included."""
STUFFED_BITS = 34 + 64
"""Those from the start of frame to the end of the CRC: at worst one more after the first five, then after each four."""
WORST_BITS = PLAIN_BITS + (STUFFED_BITS - 1) // 4
LINE_BITS = 22 * 10
"""The same frame as SLCAN text on the UART, a start and a stop bit to each character."""
TIME_PS, STATUS_PS = 20, 10
"""How often the board says TIME, and the others of PERIODIC."""


def frames_ps(kbit: int, bits: int = WORST_BITS) -> float:
    """Frames a second that fill a bus, both directions together."""
    return kbit * 1000 / bits


def housekeeping_ps() -> float:
    """Frames a second that an open link carries without any step: what the board always says, and while it is armed
    the values for the keep-alive and their answers."""
    return TIME_PS + STATUS_PS * (len(PERIODIC) - 1) + 2 / KEEPALIVE_EVERY_S


def clock_tolerance() -> float:
    """How far off each node's clock may be, as a share: the lesser of what resynchronisation makes good over ten bits
    and what an error flag's thirteen bits may drift (ISO 11898-1)."""
    return min(SJW / (20 * QUANTA), PHASE_2 / (2 * (13 * QUANTA - PHASE_2)))


@dataclass(frozen=True)
class Traffic:
    """Frames a step, to the board and from it."""

    kind: str
    down: int
    up: int

    def bus_steps_ps(self, kbit: int) -> float:
        return (frames_ps(kbit) - housekeeping_ps()) / (self.down + self.up)

    def uart_steps_ps(self) -> float:
        """Both directions at once; the busier one counts."""
        line_ps = DEFAULT_BAUD / LINE_BITS
        told_ps = housekeeping_ps() - 1 / KEEPALIVE_EVERY_S
        return min((line_ps - told_ps) / self.up, (line_ps - 1 / KEEPALIVE_EVERY_S) / self.down if self.down else 1e9)

    def share(self, kbit: int, period_us: int) -> float:
        """Of the bus, with a step every period_us."""
        return (housekeeping_ps() + (self.down + self.up) * 1e6 / period_us) / frames_ps(kbit)


def traffic(system: str) -> Iterator[Traffic]:
    """The kinds of run. samples: three channels a frame; outputs: the frames that move a plant."""
    module = systems.load(system)
    samples = (len(declarations.system(system).channels) + 2) // 3
    outputs = len({frame for frame, _ in module.OUTPUT_FRAMES.values()})
    words = RECORDS[system].itemsize // 4
    yield Traffic("lockstep, digests", samples, 1)
    yield Traffic("lockstep, every word", samples, 1 + words)
    if system in systems.with_part(PINS.name):
        yield Traffic("real time, own sensors, verified", 0, 1 + samples)
    yield Traffic("real time, through a bridge, verified", samples, 1 + 2 + outputs)


def rate_table() -> str:
    """Markdown: what a bus carries."""
    lines = ["| kbit/s | us a frame | frames/s | an open, armed link without steps |", "|---|---|---|---|"]
    for kbit in BITRATES_KBIT:
        most = frames_ps(kbit)
        lines.append(
            f"| {kbit} | {PLAIN_BITS * 1000 / kbit:.0f} to {WORST_BITS * 1000 / kbit:.0f} "
            f"| {most:.0f} to {frames_ps(kbit, PLAIN_BITS):.0f} | {100 * housekeeping_ps() / most:.1f} % |"
        )
    return "\n".join(lines) + "\n"


def step_table() -> str:
    """Markdown: steps a second of every system and kind of run, and the load of a 500 kbit/s bus at its own period."""
    head = ["system", "run", "frames down / up", "UART", *(f"CAN {kbit}" for kbit in BITRATES_KBIT), "load of 500"]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for system in systems.SYSTEMS:
        period_us = systems.load(system).PERIOD_US
        for t in traffic(system):
            own = f"{100 * t.share(500, period_us):.0f} %" if t.kind.startswith("real") else "-"
            steps = [f"{t.uart_steps_ps():.0f}", *(f"{t.bus_steps_ps(kbit):.0f}" for kbit in BITRATES_KBIT)]
            lines.append(f"| {system} | {t.kind} | {t.down} / {t.up} | {' | '.join(steps)} | {own} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(f"each node's clock may be off by {100 * clock_tolerance():.2f} %\n")
    print(rate_table())
    print(step_table())
