"""Load of the links: longest frame on a CAN bus, periodic frames of an open link, steps per second of every system.

`python -m plumb.bench.bus_load` prints the tables that docs/reference/protocol.md contains, and the traffic of steps
that send every word of their record. All are worst cases: each frame has as many stuff bits as possible, each step all
its frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from plumb import systems
from plumb.link.board_frames import KEEPALIVE_EVERY_S, PERIODIC
from plumb.link.endpoint_names import DEFAULT_BAUD
from plumb.link.sample_codec import InputLayout, layout_of
from plumb.link.selection import raw_frames_of
from plumb.spec import dbc
from plumb.spec.records import RECORDS
from plumb.systems.contracts import PINS

BITRATES_KBIT = (125, 250, 500, 1000)
QUANTA, PHASE_2, SJW = 18, 2, 2
"""Time quanta of a bit, after its sample point, and by which resynchronisation may stretch a bit."""
PLAIN_BITS = 111
"""ISO 11898-1: a data frame of eight bytes with a standard identifier, intermission included."""
STUFFED_BITS = 34 + 64
"""Bits from the start of frame to the end of the CRC: at worst a stuff bit after the first five, then after each
four."""
WORST_BITS = PLAIN_BITS + (STUFFED_BITS - 1) // 4
LINE_BITS = 22 * 10
"""Bits of the same frame as SLCAN text on the UART, with a start and a stop bit for each character."""
TIME_PS, STATUS_PS = 20, 10
"""Rates of TIME, and of the other PERIODIC frames, per second."""


def frames_ps(kbit: int, bits: int = WORST_BITS) -> float:
    """Frames per second that fill a bus, both directions together."""
    return kbit * 1000 / bits


def housekeeping_ps() -> float:
    """Frames per second of an open link without any step: the periodic frames and, while the board is armed, the values
    of the keep-alive and their answers."""
    return TIME_PS + STATUS_PS * (len(PERIODIC) - 1) + 2 / KEEPALIVE_EVERY_S


def clock_tolerance() -> float:
    """Tolerance of each node's clock, relative: the lesser of the drift that resynchronisation corrects over ten bits
    and the drift allowed over the thirteen bits of an error flag (ISO 11898-1)."""
    return min(SJW / (20 * QUANTA), PHASE_2 / (2 * (13 * QUANTA - PHASE_2)))


OWN_SENSORS = "real time, own sensors, verified"
EVERY_WORD = "lockstep, every word"


@dataclass(frozen=True)
class Traffic:
    """Frames per step, to the board and from it."""

    kind: str
    down: int
    up: int

    def bus_steps_ps(self, kbit: int) -> float:
        return (frames_ps(kbit) - housekeeping_ps()) / (self.down + self.up)

    def uart_steps_ps(self) -> float:
        """Steps per second over the UART, limited by the busier of its two directions."""
        line_ps = DEFAULT_BAUD / LINE_BITS
        sent_ps = housekeeping_ps() - 1 / KEEPALIVE_EVERY_S
        return min((line_ps - sent_ps) / self.up, (line_ps - 1 / KEEPALIVE_EVERY_S) / self.down if self.down else 1e9)

    def share(self, kbit: int, period_us: int) -> float:
        """Part of the bus that a step every period_us takes."""
        return (housekeeping_ps() + (self.down + self.up) * 1e6 / period_us) / frames_ps(kbit)


def traffic(system: str) -> Iterator[Traffic]:
    """Traffic of each kind of run. A sample takes a frame for each three channels; outputs: the frames that move a
    plant."""
    module = systems.load(system)
    samples = len(raw_frames_of(system)) - len(layout_of(system).commands)
    outputs = len({frame for frame, _ in module.OUTPUT_FRAMES.values()})
    words = RECORDS[system].itemsize // 4
    yield Traffic("lockstep, digests", samples, 1)
    yield Traffic(EVERY_WORD, samples, 1 + words)
    if system in systems.with_part(PINS.name):
        yield Traffic(OWN_SENSORS, 0, 1 + len(raw_frames_of(system)))
    yield Traffic("real time, through a bridge, verified", samples, 1 + 2 + outputs)


INPUTS_PS = 400
"""Steps per second of `inputs_table`."""
SETS_PS = 50
"""Sets of setpoint and commands per second, where not every step has one."""
INPUTS = ((6, 0), (9, 6), (12, 16))
"""Raw counts and words of commands in each row of `inputs_table`."""


def inputs_table() -> str:
    """Markdown table of the load of a step's inputs at 400 steps a second, on the UART in its busier direction and on a
    bus of 500 kbit/s. verified: the board sends the inputs of each step with its digest."""
    often, seldom = "a set with every step", f"{SETS_PS} sets a second"
    lines = ["| counts | words of commands | run | frames/s down / up | UART | CAN 500 |", "|---" * 6 + "|"]
    for counts, words in INPUTS:
        layout = InputLayout(counts, (0,) * (-(-words // 3) * 3))
        orders, samples, raw = len(layout.commands) + 1, len(layout.samples), len(dbc.raw_frames(layout.size))
        for kind, sets_ps, sampled, shown in (
            (f"own sensors, verified, {often}", INPUTS_PS, 0, raw),
            (f"own sensors, verified, {seldom}", SETS_PS, 0, raw),
            (f"own sensors, digests alone, {seldom}", SETS_PS, 0, 0),
            (f"injected samples, verified, {seldom}", SETS_PS, samples, raw),
        ):
            down = orders * sets_ps + sampled * INPUTS_PS
            up = (1 + shown) * INPUTS_PS + sets_ps  # STEP, and SETPOINT_USED of each set
            uart = max(up + housekeeping_ps() - 1 / KEEPALIVE_EVERY_S, down + 1 / KEEPALIVE_EVERY_S)
            bus = (down + up + housekeeping_ps()) / frames_ps(500)
            share = f"{100 * uart * LINE_BITS / DEFAULT_BAUD:.0f} % | {100 * bus:.0f} %"
            lines.append(f"| {counts} | {words} | {kind} | {down} / {up} | {share} |")
    return "\n".join(lines) + "\n"


def rate_table() -> str:
    """Markdown table of the frames per second of a bus."""
    lines = ["| kbit/s | us a frame | frames/s | an open, armed link without steps |", "|---|---|---|---|"]
    for kbit in BITRATES_KBIT:
        most = frames_ps(kbit)
        lines.append(
            f"| {kbit} | {PLAIN_BITS * 1000 / kbit:.0f} to {WORST_BITS * 1000 / kbit:.0f} "
            f"| {most:.0f} to {frames_ps(kbit, PLAIN_BITS):.0f} | {100 * housekeeping_ps() / most:.1f} % |"
        )
    return "\n".join(lines) + "\n"


def sensor_period_us(system: str) -> int:
    """Period of a board with its own sensors: that of their tuning. Without them it is the system's."""
    module = systems.load(system)
    if system not in systems.with_part(PINS.name):
        return module.PERIOD_US
    return module.TUNINGS[systems.load(system, PINS).TUNING].period_us


def step_table(without: str = EVERY_WORD) -> str:
    """Markdown table of the steps per second of every system and kind of run, and the load of a 500 kbit/s bus at the
    system's period. without: a kind of run to leave out; the page of the protocol has none whose frames the length of
    the record decides."""
    head = ["system", "run", "frames down / up", "UART", *(f"CAN {kbit}" for kbit in BITRATES_KBIT), "load of 500"]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for system in systems.SYSTEMS:
        for t in traffic(system):
            if t.kind == without:
                continue
            period_us = sensor_period_us(system) if t.kind == OWN_SENSORS else systems.load(system).PERIOD_US
            own = f"{100 * t.share(500, period_us):.0f} %" if t.kind.startswith("real") else "-"
            steps = [f"{t.uart_steps_ps():.0f}", *(f"{t.bus_steps_ps(kbit):.0f}" for kbit in BITRATES_KBIT)]
            lines.append(f"| {system} | {t.kind} | {t.down} / {t.up} | {' | '.join(steps)} | {own} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(f"each node's clock may be off by {100 * clock_tolerance():.2f} %\n")
    print(rate_table())
    print(step_table(without=""))
    print(inputs_table())
