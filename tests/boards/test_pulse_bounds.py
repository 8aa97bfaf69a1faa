"""The pulses of the flash image stay in bounds whatever parameters, RAM or frames say.

Every frame of pulses that TIM4 begins is looked at: 900 to 1050 us while nothing is armed, 900 to 2100 us while the
board drives, with a gap before the next one.
"""

from __future__ import annotations

import contextlib
import random
import struct
import zlib
from pathlib import Path

import pytest

pytest.importorskip("unicorn")

from plumb.errors import LinkError
from plumb.f103.core.bus import SimulationError
from plumb.f103.machine import Machine
from plumb.flash.elf import Elf
from plumb.link.identity import NackError
from plumb.link.session import Session
from plumb.link.transports.slcan import text_of_frames
from plumb.spec import parameters
from plumb.spec.protocol import protocol
from support.campaigns import campaign
from support.image_patches import without_memory_check
from support.kept import as_made
from support.pins import at_rest

BUILD = Path(__file__).parents[2] / "build/stm32f103"
pytestmark = pytest.mark.skipif(
    not (BUILD / "firmware.elf").exists(), reason="the flash image is not built: run make image"
)
BOOT_US = 30_000
RAM, SLOTS = 0x20000000, 0xF000
FAULT_PARAMETERS = 0x80
ROWS = parameters.table()
CONTROL = [row.default for row in ROWS if row.owner == "control"]
UNDEFINED = b"\x00\xde"
"""Machine code: an instruction that does not exist."""
PULSE_US, NEUTRAL_US, FRAME_US, GAP_US = (900, 2100), (900, 1050), (2040, 20_000), 20


@pytest.fixture(scope="module")
def elf() -> Elf:
    return Elf(BUILD / "firmware.elf")


@pytest.fixture(scope="module")
def image(elf: Elf) -> bytes:
    """Without the check that ends a run when memory is damaged: the bounds stand behind it."""
    return without_memory_check((BUILD / "firmware.bin").read_bytes(), elf)


class Watched:
    """The image on the virtual board, and every distinct frame of pulses that its pins began: (first, second, frame)
    in us."""

    def __init__(self, image: bytes, slot: bytes = b"") -> None:
        self.machine = Machine(image, faults="run")
        self.machine.flash.store(SLOTS, slot)
        at_rest(self.machine)
        self.frames: set[tuple[float, float, float]] = set()
        timer = self.machine.tim4
        preload = timer._preload

        def look() -> None:
            preload()
            driven = all(self.machine.port(pin).is_alternate_output(int(pin[2:])) for pin in ("PB6", "PB7"))
            if driven and timer.ccer & 0x11 == 0x11 and timer.cr1 & 1:
                pulses = [min(ccr, timer.active_arr + 1) / 2 for ccr in timer.active_ccr[:2]]
                self.frames.add((pulses[0], pulses[1], (timer.active_arr + 1) / 2))

        timer._preload = look  # type: ignore[method-assign]
        self.machine.advance_us(BOOT_US)

    def poke(self, elf: Elf, name: str, row: str, value: int) -> None:
        """A word of params_t in RAM, by the name of its row."""
        place = next(at for at, one in enumerate(ROWS) if one.name == row)
        self.machine.cpu.ram[(at := elf.symbol(name).address - RAM + 4 * place) : at + 4] = struct.pack(
            "<I", value & 0xFFFFFFFF
        )

    def began(self) -> set[tuple[float, float, float]]:
        """Frames since the last call."""
        self.machine.advance_us(50_000)
        self.machine.tim4.settle(self.machine.now)
        frames, self.frames = self.frames, set()
        return frames

    def check(self, pulse_us: tuple[int, int]) -> None:
        frames = self.began()
        for *pulses, frame_us in frames:
            assert FRAME_US[0] <= frame_us <= FRAME_US[1], frames
            for pulse in pulses:
                assert pulse_us[0] <= pulse <= pulse_us[1] and pulse <= frame_us - GAP_US, frames


class Armed(Watched):
    def __init__(self, image: bytes, esc_period_us: int) -> None:
        super().__init__(image)
        self.session = Session.open(self.machine.uart)
        self.session.upload(CONTROL, esc_period_us=esc_period_us, period_us=1000, arm_hold_ms=0)
        self.session.begin("REALTIME_LIVE")
        self.session.arm()


def armed(image: bytes, esc_period_us: int) -> Armed:
    return as_made(f"pulse bounds {esc_period_us}", lambda: Armed(image, esc_period_us))


WILD = (0, 1, 899 * 2, 1050 * 2 + 1, 1100 * 2, 4000, 4201, 16383, 65535, 0x7FFFFFFF, -1, -2000)


@pytest.mark.parametrize("value", WILD)
def test_neutral_is_in_bounds_whatever_ram_holds(image: bytes, elf: Elf, value: int) -> None:
    board = Watched(image)
    with Session.open(board.machine.uart) as session:
        session.upload(CONTROL)
        board.poke(elf, "params", "esc.neutral_halfus", value)
        board.poke(elf, "params", "esc.mid_halfus", value)
        session.begin("REALTIME_LIVE")
        board.check(NEUTRAL_US)


@pytest.mark.parametrize("value", (0, 1, 1000, 2039, 20_001, 32_768, 0x80000000, -1))
def test_the_frame_is_in_bounds_whatever_ram_holds(image: bytes, elf: Elf, value: int) -> None:
    board = Watched(image)
    with Session.open(board.machine.uart) as session:
        session.upload(CONTROL)
        board.poke(elf, "params", "esc_period_us", value)
        session.begin("REALTIME_LIVE")
        board.check(NEUTRAL_US)


@pytest.mark.slow
@pytest.mark.parametrize("value", WILD)
def test_a_driven_pulse_is_in_bounds_whatever_ram_holds(image: bytes, elf: Elf, value: int) -> None:
    board = armed(image, 2040)
    with board.session as session:
        for name in ("esc.mid_halfus", "esc.min_halfus", "esc.max_halfus"):
            board.poke(elf, "params", name, value)
        for _ in range(10):
            session.receive(0.005)
        board.check(PULSE_US)


def test_a_crash_leaves_a_constant_pulse(image: bytes, elf: Elf) -> None:
    """The fault handler trusts neither memory nor the timer's spare compare registers."""
    at = elf.symbol("session_poll").address - 0x08000000
    board = Watched(image[:at] + UNDEFINED + image[at + 2 :])
    timer, resets = board.machine.tim4, board.machine.reset_count
    timer.ccr3 = timer.ccr4 = 4000
    write, written = timer._write_ccr, []

    def look(index: int, value: int) -> None:
        written.append((index, value))
        write(index, value)

    board.machine.run_until(lambda: timer.cr1 & 1 == 1, 20_000)
    timer.ccr3 = timer.ccr4 = 4000
    board.poke(elf, "params", "esc.neutral_halfus", 4000)
    timer._write_ccr = look  # type: ignore[method-assign]
    assert board.machine.run_until(lambda: board.machine.reset_count > resets, BOOT_US)
    assert written[-2:] == [(0, 2000), (1, 2000)]


POKED, ARMED_POKED, TABLES = campaign(10, 24), campaign(6, 12), campaign(10, 30)
"""Boards whose memory is poked while disarmed, and while armed; and boards that are given some table."""


def poke_some(board: Watched, elf: Elf, chance: random.Random, names: tuple[str, ...]) -> None:
    """Words of the speed controllers' rows, and up to 32 bytes of these variables, become anything."""
    rows = [row.name for row in ROWS if row.name.startswith("esc")]
    for row in chance.sample(rows, chance.randrange(len(rows))):
        board.poke(elf, "params", row, chance.choice((chance.randrange(5000), chance.getrandbits(32))))
    for _ in range(chance.randrange(1, 33)):
        symbol = elf.symbol(chance.choice(names))
        board.machine.cpu.ram[symbol.address - RAM + chance.randrange(symbol.size)] = chance.randrange(256)


def say_anything(board: Watched, chance: random.Random) -> None:
    """Some frames from the host with any payload, sealed, and some bytes of noise."""
    known = [message for message in protocol().messages.values() if message.sender == "HOST"]
    frames = []
    for _ in range(chance.randrange(8)):
        message = chance.choice(known)
        words = message.layout.unpack(bytes(2) + chance.randbytes(6))[2:]
        frames.append((message.identifier, message.pack(chance.randrange(16), chance.randrange(16), *words)))
    board.machine.uart.write(text_of_frames(frames) + chance.randbytes(chance.randrange(20)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(POKED))
def test_disarmed_pins_stay_neutral_whatever_is_poked_and_said(image: bytes, elf: Elf, seed: int) -> None:
    chance, board = random.Random(seed), Watched(image)
    # What no chip does, or a board that has crashed, ends the round.
    with contextlib.suppress(SimulationError, LinkError), Session.open(board.machine.uart) as session:
        for _ in range(4):
            poke_some(board, elf, chance, ("params", "control"))
            session.begin(chance.choice(["LOCKSTEP", "REALTIME_LIVE", "REALTIME_INJECTED"]))
            say_anything(board, chance)
            board.check(NEUTRAL_US)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(ARMED_POKED))
def test_pulses_stay_in_bounds_whatever_is_poked_and_said(image: bytes, elf: Elf, seed: int) -> None:
    """The session's memory, too, which says whether the board is armed."""
    chance = random.Random(1000 + seed)
    board = armed(image, chance.choice([2040, 2500, 20_000]))
    with board.session as session, contextlib.suppress(SimulationError, LinkError):
        for _ in range(4):
            session.receive(0.005)
            poke_some(board, elf, chance, ("params", "control", "session"))
            say_anything(board, chance)
            board.check(PULSE_US)


# ---- tables that a host commits, and tables that were saved ----


def slot_of(words: dict[str, int]) -> bytes:
    """A sealed slot of the store (firmware/link/store.c) that holds these words, written by whoever."""
    rows = {row.name: row for row in ROWS}
    entries = b"".join(struct.pack("<HI", rows[name].id, word & 0xFFFFFFFF) for name, word in words.items())
    body = struct.pack("<HHIH", 0x6C70, 0x6170, 1, len(words)) + entries
    return body + struct.pack("<IH", zlib.crc32(body), 0)


def one_way(words: dict[str, int]) -> bool:
    """Whether these words, defaults elsewhere, are a table for one-way speed controllers, as the issue has it."""
    whole = {row.name: row.default for row in ROWS} | words
    neutral, low, mid, high = (whole[f"esc.{name}_halfus"] for name in ("neutral", "min", "mid", "max"))
    return (
        1800 <= neutral <= low <= mid <= high <= 4200
        and neutral <= 2200
        and abs(whole["esc.span_halfus"]) <= 2400
        and 2040 <= whole["esc_period_us"] <= 20_000
        and high + 40 <= 2 * whole["esc_period_us"]
    )


def any_pulses(chance: random.Random) -> dict[str, int]:
    """Some rows of the speed controllers, near their bounds or anywhere."""
    words = {}
    for name in ("mid", "min", "max", "neutral"):
        if chance.random() < 0.5:
            near = chance.choice((1800, 2000, 2200, 3000, 4000, 4200)) + chance.choice((-1, 0, 0, 1))
            words[f"esc.{name}_halfus"] = near if chance.random() < 0.8 else chance.getrandbits(31)
    if chance.random() < 0.3:
        words["esc_period_us"] = chance.choice((0, 1, 2039, 2040, 2500, 20_000, 20_001, 65_535))
    return words


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(TABLES))
def test_a_saved_table_for_other_controllers_is_not_loaded(image: bytes, seed: int) -> None:
    """Defaults, a named fault, no arming; with every other table, pulses in bounds."""
    chance = random.Random(2000 + seed)
    words = any_pulses(chance) | ({"system": chance.randrange(4)} if seed % 3 == 0 else {})
    board = Watched(image, slot_of(words))
    with Session.open(board.machine.uart) as session:
        identity = session.connect()
        assert bool(identity["FAULTS"] & FAULT_PARAMETERS) == (not one_way(words)), words
        if not one_way(words):
            assert session.read_parameters() == [row.default for row in ROWS]
            session.begin("REALTIME_LIVE")
            with pytest.raises(LinkError, match="the board has a fault"):
                session.arm()
        board.check(NEUTRAL_US)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(TABLES))
def test_a_committed_table_for_other_controllers_is_refused(image: bytes, seed: int) -> None:
    """By the board itself: these frames come from a host that checks nothing."""
    chance = random.Random(3000 + seed)
    words = {"esc.mid_halfus": 4000, "esc.neutral_halfus": 4000} if seed == 0 else any_pulses(chance)
    board = Watched(image)
    with Session.open(board.machine.uart) as session:
        whole = [words.get(row.name, row.default) for row in ROWS]
        refused = False
        for index, row in enumerate(ROWS):
            if row.name in words:
                try:
                    session.request("PARAM_SET", index, words[row.name], answer="PARAM_STAGED", first=index)
                except NackError as error:
                    assert error.reason == "RANGE"
                    refused = True
        try:
            session.request("PARAM_COMMIT", len(whole), parameters.crc32(whole))
        except NackError as error:
            assert error.reason in ("CRC", "PARAMETERS")
            refused = True
        assert refused == (not one_way(words)), words
        session.begin("REALTIME_LIVE")
        board.check(NEUTRAL_US)


@pytest.mark.slow
def test_a_new_neutral_pulse_is_on_the_pins_for_the_whole_hold(image: bytes) -> None:
    """A change of the pulses disarms: the next arming holds the new neutral pulse for arm_hold_ms."""
    board = Watched(image)
    with Session.open(board.machine.uart) as session:
        words = {row.name: row.default for row in ROWS} | {"esc.neutral_halfus": 1900}
        for control in (CONTROL, [words[row.name] for row in ROWS if row.owner == "control"]):
            session.upload(control, period_us=1000, esc_period_us=2500, arm_hold_ms=200)
            session.begin("REALTIME_LIVE")
            session.arm()
            held_from = board.machine.now_us
            board.frames.clear()
            while board.machine.now_us < held_from + 190_000:
                session.receive(0.005)
                board.machine.tim4.settle(board.machine.now)
            neutral_us = control[[row.name for row in ROWS].index("esc.neutral_halfus")] / 2
            assert {frame[:2] for frame in board.frames} == {(neutral_us, neutral_us)}
            while board.machine.now_us < held_from + 300_000:
                session.receive(0.005)
                board.machine.tim4.settle(board.machine.now)
            assert len({frame[:2] for frame in board.frames}) > 1
