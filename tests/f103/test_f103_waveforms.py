"""The VCD file of a traced board: what decoders find in the lines is what the models moved, and tracing changes
nothing."""

from __future__ import annotations

import bisect
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
pytest.importorskip("vcd", reason="a VCD file needs pyvcd (the extra virtual)")
from vcd.reader import TokenKind, tokenize

from plumb.boards import plant_on_pins
from plumb.boards.virtual import VirtualBoard
from plumb.errors import UsageError
from plumb.f103.attached.canwire import WireFrame, frame_bits, frame_levels
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.waveforms import VcdTrace
from plumb.link.monitor import begin_live
from plumb.link.transports.slcan import frame_of_line
from plumb.spec.protocol import Frame, check

UNITS_PER_US = 10
Seen = dict[str, float]
GYRO_READ = (0x68 << 1, 0x1D)


@dataclass
class Signal:
    """Changes of one line: times in units of the file, and the values from then on. end: of the file."""

    times: list[int]
    values: list[str | float]
    end: int = 0

    def at(self, time: float) -> str | float:
        return self.values[max(0, bisect.bisect_right(self.times, time) - 1)]

    def edges(self, value: str) -> list[int]:
        return [time for time, one in zip(self.times, self.values, strict=True) if one == value]


def read_vcd(path: Path) -> dict[str, Signal]:
    """Every line by scope and name, as a viewer reads it."""
    names, signals, scope, time = {}, {}, [], 0
    with path.open("rb") as file:
        for token in tokenize(file):
            if token.kind is TokenKind.SCOPE:
                scope.append(token.scope.ident)
            elif token.kind is TokenKind.UPSCOPE:
                scope.pop()
            elif token.kind is TokenKind.VAR:
                names[token.var.id_code] = ".".join([*scope, token.var.reference])
                signals[names[token.var.id_code]] = Signal([], [])
            elif token.kind is TokenKind.CHANGE_TIME:
                assert token.time_change >= time
                time = token.time_change
            elif token.kind in (TokenKind.CHANGE_SCALAR, TokenKind.CHANGE_REAL):
                change = token.scalar_change if token.kind is TokenKind.CHANGE_SCALAR else token.real_change
                signals[names[change.id_code]].times.append(time)
                signals[names[change.id_code]].values.append(change.value)
    for signal in signals.values():
        signal.end = time
    return signals


def uart_bytes(line: Signal, baud: int = 921600) -> bytes:
    """A UART decoder: start bit, eight bits, stop bit."""
    bit, out, at = UNITS_PER_US * 1e6 / baud, bytearray(), 0.0
    for start in line.edges("0"):
        if start < at or start + 10 * bit > line.end:
            continue
        out.append(sum((line.at(start + (1.5 + n) * bit) == "1") << n for n in range(8)))
        assert line.at(start + 9.5 * bit) == "1"
        at = start + 9.2 * bit
    return bytes(out)


def can_frames(line: Signal, kbit: int = 500) -> list[Frame]:
    """A CAN decoder for standard data frames that were acknowledged."""
    bit, free = UNITS_PER_US * 1e3 / kbit, 0.0
    frames: list[Frame] = []
    for start in line.edges("0"):
        if start < free:
            continue
        bits, last, at, run = "", "", start + bit / 2, 0
        while len(bits) < 19 or len(bits) < 34 + 8 * int(bits[15:19], 2) or run == 5:
            if at + 3 * bit > line.end:
                return frames
            level, stuffed = str(line.at(at)), run == 5
            at += bit
            assert not stuffed or level != last, "stuff bit"
            run, last = (run + 1 if level == last else 1), level
            bits += "" if stuffed else level
        assert (line.at(at), line.at(at + bit)) == ("1", "0"), "delimiter, acknowledgement"
        length = int(bits[15:19], 2)
        frames.append((int(bits[1:12], 2), int(bits[19 : 19 + 8 * length], 2).to_bytes(length, "big")))
        free = at + 9 * bit
    return frames


WAITING_MAX = 16
"""Two rounds of what a board sends every 100 ms, 8 frames at most: sent before the trace began, not read yet."""


def missing(frames: list[Frame], on_the_line: list[Frame]) -> int:
    """Number of frames that are not on the line; they came first, before the trace began."""
    absent = [frame for frame in frames if frame not in on_the_line]
    assert frames[: len(absent)] == absent
    return len(absent)


def i2c_transfers(scl: Signal, sda: Signal) -> list[list[tuple[int, bool]]]:
    """An I2C decoder: (byte, acknowledged) of every transfer, by START, clock edges and STOP."""
    changes = sorted([(t, 0, v) for t, v in zip(scl.times, scl.values, strict=True)]
                     + [(t, 1, v) for t, v in zip(sda.times, sda.values, strict=True)])  # fmt: skip
    found: list[list[tuple[int, bool]]] = []
    clock = data = "1"
    bits: list[int] = []
    for _, which, value in changes:
        if which == 0:
            if value == "1" and clock == "0" and found:
                bits.append(int(data))
                if len(bits) == 9:
                    found[-1].append((int("".join(map(str, bits[:8])), 2), not bits[8]))
                    bits = []
            clock = str(value)
        else:
            if clock == "1" and value != data:
                bits = []
                if value == "0":
                    found.append([])
            data = str(value)
    return [transfer for transfer in found if transfer]


Traced = tuple[dict[str, Signal], list[Frame], Seen]


def live(system: str, link: str, path: Path | None) -> tuple[list[Frame], Seen]:
    """A live run of 0.12 s: the frames received, and time and pulse at the end."""
    board = VirtualBoard(link=link)
    with board:
        plant_on_pins.show(board, system, None, 1000)
        trace = None if path is None else VcdTrace(board.machine, path)
        frames: list[Frame] = []
        board.session.listener = frames.extend
        begin_live(board.session)
        end_us = board.machine.now_us + 120_000
        while board.machine.now_us < end_us:
            board.session.receive(0.01)
            if trace is not None:
                trace.flush()
        board.session.listener = None
        seen: Seen = {"us": board.machine.now_us, "pulse_us": board.machine.pwm("PB6").pulse_us}
        if trace is not None:
            trace.close()
            trace.close()
        board.session.end()
    return frames, seen


@pytest.fixture(scope="module")
def quad(image: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Traced]:
    path = tmp_path_factory.mktemp("quad") / "board.vcd"
    frames, seen = live("quad", "serial", path)
    yield read_vcd(path), frames, seen


def test_the_uart_s_lines_carry_the_frames(quad: Traced) -> None:
    signals, frames, _ = quad
    lines = uart_bytes(signals["uart.UART_TX"]).split(b"\r")
    sent = [frame for frame in map(frame_of_line, lines) if frame]
    assert len(frames) > 30 and missing(frames, sent) < WAITING_MAX
    asked = [frame_of_line(line) for line in uart_bytes(signals["uart.UART_RX"]).split(b"\r")]
    assert any(frame and check(*frame) for frame in asked)


def test_pulses_and_volts_are_those_of_the_pins(quad: Traced) -> None:
    signals, _, seen = quad
    pulse = signals["pins.PB6"]
    rises, falls = pulse.edges("1")[1:], pulse.edges("0")
    lengths = [falls[bisect.bisect_right(falls, rise)] - rise for rise in rises[:-1]]
    # Pulses have steps of 0.5 us: less than half of one.
    # The frame is shortened once, when the run begins; after that every pulse is the same.
    assert len(lengths) > 40 and all(abs(length / UNITS_PER_US - seen["pulse_us"]) < 0.2 for length in lengths[-40:])
    volts = [value for value in signals["adc.ADC_PA0"].values if isinstance(value, float)]
    assert len(volts) > 10 and all(0.0 <= value <= 3.3 for value in volts[1:])


def test_tracing_changes_nothing(quad: Traced) -> None:
    _, frames, seen = quad
    plain, plainly = live("quad", "serial", None)
    assert (plain, plainly) == (frames, seen)


@pytest.mark.slow
def test_can_and_i2c_decode_to_what_the_board_did(image: Path, tmp_path: Path) -> None:
    frames, _ = live("balancer", "can", tmp_path / "board.vcd")
    signals = read_vcd(tmp_path / "board.vcd")
    on_wire = can_frames(signals["can.CAN"])
    assert len(frames) > 30 and missing(frames, on_wire) < WAITING_MAX
    assert all(check(*frame) for frame in on_wire)
    transfers = i2c_transfers(signals["i2c.I2C_SCL"], signals["i2c.I2C_SDA"])
    wanted = [transfer for transfer in transfers if tuple(byte for byte, _ in transfer[:2]) == GYRO_READ]
    assert len(wanted) >= 8 and all(acknowledged for transfer in wanted for _, acknowledged in transfer)
    reads = [transfer for transfer in transfers if transfer[0][0] == GYRO_READ[0] | 1]
    data, settings = ([one for one in reads if len(one) == length] for length in (7, 2))
    assert all(not one[-1][1] for one in reads) and len(data) >= 8 and len(data) + len(settings) == len(reads)


@pytest.mark.parametrize("data", [b"", b"\x00" * 8, b"\xff" * 8, bytes(range(8))])
@pytest.mark.parametrize("extended", [False, True])
def test_levels_of_a_can_frame_are_as_long_as_the_frame(data: bytes, extended: bool) -> None:
    frame = WireFrame(0x2AA, data, extended)
    levels = frame_levels(frame, True)
    assert len(levels) == frame_bits(frame) and levels[0] == "0"
    assert "000000" not in levels[: -12] and "111111" not in levels[: -12]  # fmt: skip


def test_a_reset_ends_what_was_on_its_way_out(image: Path, tmp_path: Path) -> None:
    with VirtualBoard() as board:
        with VcdTrace(board.machine, tmp_path / "board.vcd"):
            board.machine.uart.write(b"V\rV\rV\rV\r")
            board.machine.advance_us(60)
            reset_us = board.machine.now_us
            board.machine.reset()
            board.machine.advance_us(30_000)
        line = read_vcd(tmp_path / "board.vcd")["uart.UART_TX"]
        late = [time for time in line.edges("0") if reset_us < time / UNITS_PER_US < reset_us + 2000]
        assert late == []
        board.machine.snapshot()  # possible again, and while it is traced
        board.restart()


def test_a_path_that_cannot_be_used_is_one_sentence(
    image: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with VirtualBoard() as board:
        (tmp_path / "notes").write_text("mine")
        for path, text in ((tmp_path / "notes", "no VCD file"), (tmp_path, "directory"), (tmp_path / "a/b", "No such")):
            with pytest.raises(UsageError, match=text) as caught:
                VcdTrace(board.machine, path)
            assert "\n" not in str(caught.value) and board.machine.probe is None
        assert (tmp_path / "notes").read_text() == "mine"
        for _ in range(2):  # an older trace is replaced
            VcdTrace(board.machine, tmp_path / "trace").close()
        trace = VcdTrace(board.machine, Path("/dev/full"))
        board.machine.advance_us(100_000)
        with pytest.raises(UsageError, match="cannot be written: No space left"):
            for _ in range(2000):
                board.machine.uart.write(b"V\r")
                board.machine.advance_us(5_000)
                trace.flush()
        with pytest.raises(UsageError, match="/dev/full cannot be written: No space left"):
            trace.close()
        trace.close()
        monkeypatch.setitem(__import__("sys").modules, "vcd", None)
        with pytest.raises(UsageError, match=r"pyvcd; install it"):
            VcdTrace(board.machine, tmp_path / "none")
    assert TICKS_PER_US % 10 == 0
