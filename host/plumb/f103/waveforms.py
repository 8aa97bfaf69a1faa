"""Record pins and buses of a simulated chip as a VCD file, for GTKWave, PulseView and sigrok.

    with VcdTrace(machine, Path("board.vcd")) as trace:
        machine.advance_us(10_000)
        trace.flush()

Scopes: `pins` (every pin of the small package, with PWM), `uart`, `can`, `i2c`, `spi` (the lines of each), `adc` (volts
at the instants of conversion). A line that nothing drives is z. The time unit is 100 ns:
finer than every bit time here, and coarse enough for viewers that keep a sample for each unit of time.

Tracing does not change a run: a traced board behaves the same to the bit.
"""

from __future__ import annotations

import heapq
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from plumb.errors import UsageError
from plumb.extras import install_hint
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.peripherals.adc import PINS as ADC_PINS

if TYPE_CHECKING:
    from plumb.f103.core.probe import Waveform
    from plumb.f103.machine import Machine

TIMESCALE = "100 ns"
TICKS_PER_UNIT = TICKS_PER_US // 10
HOLDBACK_TICKS = 2000 * TICKS_PER_US
"""A value is written once it is this old: models report a byte when it is complete, up to 0.1 ms after it began."""
FLUSH_TICKS = 10 * HOLDBACK_TICKS
PINS = (*(f"PA{n}" for n in range(16)), *(f"PB{n}" for n in range(16)), "PC13", "PC14", "PC15")
PWM_CHANNELS = {
    "TIM2": (("PA0", 0), ("PA1", 1), ("PA2", 2), ("PA3", 3)),
    "TIM3": (("PA6", 0), ("PA7", 1), ("PB0", 2), ("PB1", 3)),
    "TIM4": (("PB6", 0), ("PB7", 1), ("PB8", 2), ("PB9", 3)),
}
BRIDGE_PINS = {"high": ("PA8", "PA9", "PA10"), "low": ("PB13", "PB14", "PB15")}
LINES = (
    *(("pins", pin) for pin in PINS),
    ("uart", "UART_TX"), ("uart", "UART_RX"), ("can", "CAN"), ("can", "CAN_BOARD_SENDS"),
    ("i2c", "I2C_SCL"), ("i2c", "I2C_SDA"), ("spi", "SPI_SCK"), ("spi", "SPI_MOSI"), ("spi", "SPI_MISO"),
)  # fmt: skip
IDLE_HIGH = {
    ("uart", "UART_TX"),
    ("uart", "UART_RX"),
    ("can", "CAN"),
    ("i2c", "I2C_SCL"),
    ("i2c", "I2C_SDA"),
    ("spi", "SPI_SCK"),
}

Level = str | float
Line = tuple[str, str]


class _Variable(Protocol):
    """A variable of the VCD writer."""


class VcdTrace:
    """Writes the waveforms of a machine from its construction on. flush() writes the values so far; close() ends the
    file."""

    def __init__(self, machine: Machine, path: Path) -> None:
        """Raises UsageError for a path that cannot be written or holds something else, and without pyvcd."""
        try:
            from vcd import VCDWriter
        except ImportError:
            raise UsageError(f"a VCD file needs pyvcd; install it {install_hint('virtual')}") from None
        self.machine, self.path = machine, path
        self._waiting: list[tuple[int, int, Line, Level]] = []
        self._order = self._written = self._flush_at = 0
        self._timers: dict[str, int] = {}
        self._levels: dict[Line, Level] = {}
        self._looked: dict[Line, Level] = {}
        self._own_edges = machine.tim1.trace is None
        _check_free(path)
        try:
            self._file = path.open("w", encoding="ascii")
        except OSError as error:
            raise UsageError(f"{path} cannot be written: {error.strerror}") from None
        self._writer = VCDWriter(self._file, timescale=TIMESCALE, version="plumb", check_values=False)
        self._variables: dict[Line, _Variable] = {}
        for scope, name in LINES:
            first = "1" if (scope, name) in IDLE_HIGH else "0" if name == "CAN_BOARD_SENDS" else "z"
            self._variables[scope, name] = self._writer.register_var(scope, name, "wire", size=1, init=first)
        for pin in ADC_PINS[:10]:
            self._variables["adc", pin] = self._writer.register_var("adc", f"ADC_{pin}", "real", init=0.0)
        if self._own_edges:
            machine.tim1.trace = []
        machine.probe = self
        self.pins_changed(machine.now)

    def __enter__(self) -> VcdTrace:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # The file

    def flush(self) -> None:
        """Write the values that are older than HOLDBACK_TICKS, if there may be many; call it often. Raises UsageError
        when the disk is full."""
        if self.machine.now >= self._flush_at:
            self._flush_at = self.machine.now + FLUSH_TICKS
            self._settle()
            self._write(self.machine.now - HOLDBACK_TICKS)

    def close(self) -> None:
        """Write all values up to now, and close the file; safe to call twice. Raises UsageError as flush()."""
        if self.machine.probe is not self:
            return
        self._settle()
        self.machine.probe = None
        if self._own_edges:
            self.machine.tim1.trace = None
        try:
            with self._file:  # it is closed, and so flushed, in any case
                self._write(self.machine.now)
                self._writer.close(max(self.machine.now // TICKS_PER_UNIT, self._written))
        except OSError as error:
            raise UsageError(f"{self.path} cannot be written: {error.strerror}") from None

    def _settle(self) -> None:
        """Bring the models up to date that compute their state only when it is read."""
        machine, now = self.machine, self.machine.now
        for timer in (machine.tim2, machine.tim3, machine.tim4, machine.tim1):
            timer.settle(now)
        for edge in machine.tim1.trace or () if self._own_edges else ():
            line = "pins", BRIDGE_PINS[edge.side][edge.phase]
            self._looked.pop(line, None)
            self._put(edge.time, line, _level(edge.on))
        if self._own_edges and machine.tim1.trace:
            machine.tim1.trace.clear()
        machine.usart.settle(now)

    def _put(self, time: int, line: Line, level: Level) -> None:
        self._order += 1
        heapq.heappush(self._waiting, (time, self._order, line, level))

    def _write(self, until: int) -> None:
        waiting, levels, change = self._waiting, self._levels, self._writer.change
        try:
            while waiting and waiting[0][0] <= until:
                time, _, line, level = heapq.heappop(waiting)
                if levels.get(line) != level:
                    levels[line] = level
                    self._written = max(self._written, time // TICKS_PER_UNIT)
                    change(self._variables[line], self._written, level)  # type: ignore[arg-type]
        except OSError as error:
            raise UsageError(f"{self.path} cannot be written: {error.strerror}") from None

    # Reports of the models

    def restarted(self, now: int) -> None:
        """Drop the bytes and frames that the part was sending, and set its lines to their levels after a reset. Bytes
        on the way to the part still arrive."""
        incoming = "uart", "UART_RX"
        self._waiting = [entry for entry in self._waiting if entry[0] <= now or entry[2] == incoming]
        heapq.heapify(self._waiting)
        for line in IDLE_HIGH - {incoming}:
            self._put(now, line, "1")
        self._timers.clear()
        self.pins_changed(now)

    def pins_changed(self, now: int) -> None:
        for letter, port in zip("ABC", self.machine.ports, strict=False):
            for number in range(13 if letter == "C" else 0, 16):
                if not port.is_alternate_output(number):
                    self._put_new(now, ("pins", f"P{letter}{number}"), _level(port.level(number)))

    def _put_new(self, now: int, line: Line, level: Level) -> None:
        """As `_put`, for a line that is sampled much more often than it changes."""
        if self._looked.get(line) != level:
            self._looked[line] = level
            self._put(now, line, level)

    def uart(self, line: str, start: int, byte_ticks: int, data: bytes) -> None:
        place = "uart", f"UART_{line}"
        for index, byte in enumerate(data):
            begin, level = start + index * byte_ticks, -1
            for bit, value in enumerate((0, *(byte >> n & 1 for n in range(8)), 1)):
                if value != level:
                    self._put(begin + bit * byte_ticks // 10, place, str(value))
                    level = value

    def can(self, start: int, bit_ticks: int, levels: str, from_board: bool) -> None:
        self._put(start, ("can", "CAN_BOARD_SENDS"), str(int(from_board)))
        last = "1"
        for index, level in enumerate(levels):
            if level != last:
                self._put(start + index * bit_ticks, ("can", "CAN"), level)
                last = level
        self._put(start + len(levels) * bit_ticks, ("can", "CAN_BOARD_SENDS"), "0")

    def i2c(self, what: str, end: int, clock_ticks: int, byte: int, acknowledged: bool) -> None:
        scl, sda, quarter = ("i2c", "I2C_SCL"), ("i2c", "I2C_SDA"), clock_ticks // 4
        if what == "byte":
            bits = (*(byte >> n & 1 for n in range(7, -1, -1)), int(not acknowledged))
            for index, bit in enumerate(bits):
                begin = end - (len(bits) - index) * clock_ticks
                self._put(begin + quarter // 2, sda, str(bit))
                self._put(begin + 2 * quarter, scl, "1")
                self._put(begin + 4 * quarter, scl, "0")
            return
        before, after = ("1", "0") if what == "start" else ("0", "1")
        begin = end - clock_ticks
        self._put(begin, sda, before)
        self._put(begin + quarter, scl, "1")
        self._put(begin + 2 * quarter, sda, after)
        if what == "start":
            self._put(begin + 3 * quarter, scl, "0")

    def spi(self, end: int, byte_ticks: int, out: int, answer: int) -> None:
        bit_ticks = byte_ticks // 8
        for index in range(8):
            begin = end - (8 - index) * bit_ticks
            self._put(begin, ("spi", "SPI_SCK"), "0")
            self._put(begin, ("spi", "SPI_MOSI"), str(out >> (7 - index) & 1))
            self._put(begin, ("spi", "SPI_MISO"), str(answer >> (7 - index) & 1))
            self._put(begin + bit_ticks // 2, ("spi", "SPI_SCK"), "1")

    def timer(self, timer: Waveform, until: int) -> None:
        """Edges of a timer's outputs since the last call; pulses begin at whole periods from zero_at on."""
        since = self._timers.get(timer.name, until)
        self._timers[timer.name] = until
        for pin, index in PWM_CHANNELS.get(timer.name, ()):
            high = timer.high_ticks(index)
            if high is None or not self.machine.port(pin).is_alternate_output(int(pin[2:])):
                continue
            period = timer.period_ticks
            begin = since - (since - timer.zero_at) % period
            self._looked.pop(("pins", pin), None)
            while begin < until:
                for edge, level in ((begin, "1" if high else "0"), (begin + high, "0" if high < period else "1")):
                    if since <= edge < until:
                        self._put(edge, ("pins", pin), level)
                begin += period

    def volts(self, pin: str, time: int, volts: float) -> None:
        if ("adc", pin) in self._variables:
            self._put(time, ("adc", pin), float(volts))


def _level(high: bool | None) -> str:
    return "z" if high is None else "1" if high else "0"


def _check_free(path: Path) -> None:
    """Raises UsageError for a file that is no VCD file: an older trace is replaced, nothing else."""
    try:
        with path.open("rb") if path.is_file() else BytesIO() as file:
            begin = file.read(1)
    except OSError:
        return  # opening it for writing says why
    if begin not in (b"", b"$"):
        raise UsageError(f"{path} exists and is no VCD file; choose another name")
