"""The flash image's CAN driver on the simulated bus: rates, filters, order, and everything that a bus can do wrong."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("unicorn")

from plumb.f103.attached.canwire import ACK, BIT_RECESSIVE, STUFF, WireFrame
from plumb.f103.machine import Machine
from plumb.link.transports.slcan import SlcanParser, text_of_frames
from plumb.spec import parameters
from plumb.spec.protocol import Frame, protocol

IMAGE = Path(__file__).parents[2] / "build/stm32f103/firmware.bin"
pytestmark = pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")
BOOT_US = 30_000
FAULT_CLOCK_FALLBACK, FAULT_CAN_OVERRUN = 0x100, 0x800


class CanBoard:
    """The image, started, with frames by name on both of its links."""

    def __init__(self, **options: Any) -> None:
        self.machine = Machine(IMAGE, **options)
        self.machine.advance_us(BOOT_US if options.get("crystal", True) else 150_000)
        self.wire = self.machine.can.wire
        self._counter: dict[int, int] = {}
        self._parser = SlcanParser()

    def frame(self, name: str, *words: int, flags: int = 0) -> Frame:
        message = protocol()[name]
        counter = self._counter.get(message.identifier, 0)
        self._counter[message.identifier] = counter + 1 & 15
        return message.identifier, message.pack(counter, flags, *words)

    def say(self, name: str, *words: int, flags: int = 0) -> None:
        self.wire.send(WireFrame(*self.frame(name, *words, flags=flags)))

    def hello(self) -> None:
        self.say("HELLO", protocol().version, protocol().dbc_hash)

    def received(self, us: float = 20_000) -> list[tuple[str, dict[str, int]]]:
        self.machine.advance_us(us)
        known = protocol().by_identifier
        return [(known[f.identifier].name, known[f.identifier].decode(f.data)) for f in self.wire.pop_frames()]

    def over_uart(self, name: str, *words: int, us: float = 20_000) -> list[tuple[str, dict[str, int]]]:
        """What the UART says within that time, after this request."""
        self.machine.uart.write(text_of_frames([self.frame(name, *words)]))
        self.machine.advance_us(us)
        known = protocol().by_identifier
        frames = self._parser.feed(self.machine.uart.read(100_000))
        return [(known[identifier].name, known[identifier].decode(data)) for identifier, data in frames]

    def open_uart(self) -> None:
        self.machine.uart.write(b"\rO\r")
        self.over_uart("HELLO", protocol().version, protocol().dbc_hash)

    def health(self) -> dict[str, int]:
        """The controller's state as the UART reports it."""
        said = self.over_uart("PARAM_GET", 0, 0, us=110_000)
        return [words for name, words in said if name == "CAN_HEALTH"][-1]

    def commit(self, **changes: int) -> None:
        """Change parameters over the UART."""
        rows = parameters.table()
        words = [changes.get(row.name, row.default) for row in rows]
        for index, row in enumerate(rows):
            if row.name in changes:
                self.over_uart("PARAM_SET", index, words[index])
        answers = self.over_uart("PARAM_COMMIT", len(words), parameters.crc32(words))
        assert "ACK" in [name for name, _ in answers]


@pytest.fixture
def board() -> CanBoard:
    board = CanBoard()
    assert board.machine.warnings == []
    return board


def names(said: list[tuple[str, dict[str, int]]]) -> list[str]:
    return [name for name, _ in said]


def test_hello_opens_the_link_and_close_ends_it(board: CanBoard) -> None:
    assert board.received(300_000) == []
    board.hello()
    items = [words for name, words in board.received() if name == "IDENTITY"]
    assert items[-1] == {"item": 65535, "value": len(items) - 1}
    assert {"TIME", "STATUS", "COUNTERS", "EVENTS", "CAN_HEALTH"} <= set(names(board.received(200_000)))
    board.say("CLOSE", 0, 0)
    assert "ACK" in names(board.received())
    assert board.received(300_000) == []
    assert board.machine.warnings == []


@pytest.mark.parametrize("kbit", [125, 250, 500, 1000])
def test_every_bit_rate_is_exact(board: CanBoard, kbit: int) -> None:
    board.open_uart()
    board.commit(can_bitrate_kbit=kbit)
    assert board.machine.can.kbit == kbit
    assert board.machine.can.quanta == 18
    assert board.machine.can.sample_point == pytest.approx(0.889, abs=0.001)
    board.wire.kbit = kbit
    board.hello()
    assert names(board.received(60_000)).count("IDENTITY") > 15


def test_a_rate_that_cannot_be_exact_is_refused(board: CanBoard) -> None:
    board.open_uart()
    rows = parameters.table()
    index = next(i for i, row in enumerate(rows) if row.name == "can_bitrate_kbit")
    words = [300 if i == index else row.default for i, row in enumerate(rows)]
    board.over_uart("PARAM_SET", index, 300)
    answers = board.over_uart("PARAM_COMMIT", len(words), parameters.crc32(words))
    assert [words["reason"] for name, words in answers if name == "NACK"] == [6]  # PARAMETERS
    assert board.machine.can.kbit == 500


def test_only_the_hosts_identifiers_pass_the_filters(board: CanBoard) -> None:
    mine = {message.identifier for message in protocol().messages.values() if message.sender == "HOST"}
    passing = {i for i in range(0x800) if board.machine.can.match(WireFrame(i, bytes(8))) is not None}
    assert passing == mine
    some = min(mine)
    assert board.machine.can.match(WireFrame(some, bytes(8), remote=True)) is None
    assert board.machine.can.match(WireFrame(some << 18, bytes(8), extended=True)) is None


def test_frames_go_out_in_the_order_they_were_queued(board: CanBoard) -> None:
    """Not by identifier: a STEP before its words, though the words would win."""
    board.hello()
    board.received(300_000)
    for bank, mask in ((0, 4), (1, 0xFF)):
        board.say("SELECT", bank, mask)
    board.say("CHALLENGE", 16, 0)
    nonce = dict(board.received())["NONCE"]["nonce"]
    board.say("RUN_BEGIN", 16, nonce)
    board.received()
    for step in range(20):
        message = protocol()["SAMPLE_A"]
        data = message.pack(step & 15, step >> 4 & 3, 1, 2, step)
        board.wire.send(WireFrame(message.identifier, data))
    steps = [entry for entry in board.received(80_000) if entry[0] in ("STEP", "QUAD_ANGLE", "WORD")]
    assert names(steps) == (["STEP", "QUAD_ANGLE", *["WORD"] * 8]) * 20
    assert [words["step"] for name, words in steps if name == "STEP"] == list(range(20))


def test_a_frame_whose_release_takes_time_is_taken_once(board: CanBoard) -> None:
    board.machine.can.release_ticks = 40320  # 1 us
    board.hello()
    board.received()
    for index in range(12):
        board.say("PARAM_GET", index, 0)
    values = [words["index"] for name, words in board.received() if name == "PARAM_VALUE"]
    assert values == list(range(12))


@pytest.mark.slow
def test_an_answer_after_a_long_silence_may_wait_for_others(board: CanBoard) -> None:
    """Patience with a frame begins when it was given to the controller."""
    board.machine.advance_us(3_000_000)
    for number in range(40):
        board.wire.send(WireFrame(0x000, bytes([number])))
        if number == 0:
            board.hello()
    items = [words["item"] for name, words in board.received(60_000) if name == "IDENTITY"]
    assert items == [*range(len(items) - 1), 65535]


def test_a_bus_that_is_busy_for_longer_than_the_patience_loses_nothing(board: CanBoard) -> None:
    """Every word of steps in lockstep at 125 kbit/s, most of a second without a free mailbox."""
    board.open_uart()
    board.commit(can_bitrate_kbit=125)
    board.wire.kbit = 125
    board.hello()
    board.received(60_000)
    board.say("SELECT", 1, 0xFFFFFFFF)
    board.received()
    board.say("CHALLENGE", 16, 0)
    board.say("RUN_BEGIN", 16, dict(board.received())["NONCE"]["nonce"])
    board.received()
    sample = protocol()["SAMPLE_A"]
    for first in (0, 12):
        for step in range(first, first + 12):
            board.wire.send(WireFrame(sample.identifier, sample.pack(step & 15, step >> 4 & 3, 1, 2, step)))
        if not first:
            board.machine.advance_us(300_000)
    said = [entry for entry in board.received(900_000) if entry[0] in ("STEP", "WORD")]
    assert [words["step"] for name, words in said if name == "STEP"] == list(range(24))
    assert [words["index"] for name, words in said if name == "WORD"] == list(range(32)) * 24


def test_nobody_acknowledges(board: CanBoard) -> None:
    """Alone with a transceiver: the controller repeats for ever, never bus-off; the frames are given up, the link
    closes, the UART does not notice, and a later host is served at once."""
    board.open_uart()
    board.hello()
    board.received(5000)
    board.wire.acknowledged = False
    assert board.received(400_000) == []
    health = board.health()
    assert (health["transmit_errors"], health["last_error"], health["bus_offs"]) == (128, ACK, 0)
    board.machine.advance_us(2_500_000)
    board.wire.acknowledged = True
    assert board.received(500_000) == []  # closed by silence, and nothing old is said
    board.hello()
    assert "IDENTITY" in names(board.received(20_000))
    assert board.health()["transmit_errors"] < 128
    assert board.machine.reset_count == 1


@pytest.mark.slow
def test_bus_off_and_back_after_a_pause_that_doubles(board: CanBoard) -> None:
    board.open_uart()
    board.hello()
    board.received(5000)
    can = board.machine.can
    pauses: list[float] = []
    for _ in range(9):
        board.wire.fail_sending.extend([BIT_RECESSIVE] * 32)
        assert board.machine.run_until(lambda: can.bus_off, 700_000)
        board.wire.fail_sending.clear()
        start_us = board.machine.now_us
        if not pauses:
            board.hello()  # while off: waits with the others on the bus
        assert board.machine.run_until(lambda: can.listening, 2_000_000)
        pauses.append(board.machine.now_us - start_us)
        board.machine.advance_us(300_000)  # not long enough to be trusted
        board.hello()
    expected_us = [1000 * min(10 * 2**n, 1000) for n in range(9)]
    recovery_us = 128 * 11 * 2
    for pause, expected in zip(pauses, expected_us, strict=True):
        assert expected + recovery_us <= pause <= expected + recovery_us + 4000
    assert board.health()["bus_offs"] == 9
    board.hello()
    assert "IDENTITY" in names(board.received())
    board.machine.advance_us(1_200_000)  # it holds for a second: the next pause is short again
    board.wire.fail_sending.extend([BIT_RECESSIVE] * 32)
    board.hello()
    assert board.machine.run_until(lambda: can.bus_off, 700_000)
    start_us = board.machine.now_us
    assert board.machine.run_until(lambda: can.listening, 2_000_000)
    assert board.machine.now_us - start_us < 10_000 + recovery_us + 4000


def test_a_short_bus_off_costs_time_and_no_frame(board: CanBoard) -> None:
    """In a run: what waited in the controller and in the queue is said after it, in order."""
    board.hello()
    board.received()
    board.say("CHALLENGE", 18, 0)
    board.say("RUN_BEGIN", 18, dict(board.received())["NONCE"]["nonce"])
    board.received(205_000)
    board.wire.fail_sending.extend([BIT_RECESSIVE] * 32)
    assert board.machine.run_until(lambda: board.machine.can.bus_off, 500_000)
    said = board.received(300_000)
    steps = [words["step"] for name, words in said if name == "STEP"]
    assert steps == list(range(steps[0], steps[0] + len(steps))) and len(steps) >= 15
    board.say("CLOSE", 0, 0)
    board.hello()
    counters = [words for name, words in board.received(200_000) if name == "COUNTERS"]
    # 96 is the warning limit of a CAN controller (RM0008, EWGF of CAN_ESR).
    assert counters[-1]["dropped"] == 0 and board.machine.can.tec < 96


def test_an_answer_that_waited_out_a_long_pause_is_not_given_up(board: CanBoard) -> None:
    """A pause longer than the patience with one frame, and others who go first after it."""
    board.hello()
    board.received()
    for _ in range(7):  # 10, 20, ... 640 ms
        board.wire.fail_sending.extend([BIT_RECESSIVE] * 32)
        board.hello()
        assert board.machine.run_until(lambda: board.machine.can.bus_off, 500_000)
        board.wire.babble(WireFrame(0x000, bytes(8)))
        assert board.machine.run_until(lambda: board.machine.can.listening, 2_000_000)
        board.machine.advance_us(5_000)
        board.wire.babble(None)
        items = [words["item"] for name, words in board.received(60_000) if name == "IDENTITY"]
        assert items == [*range(len(items) - 1), 65535]


def test_a_few_errors_cost_repetitions_and_nothing_else(board: CanBoard) -> None:
    board.hello()
    board.wire.fail_sending.extend([STUFF] * 5)
    board.wire.fail_receiving.extend([STUFF] * 5)
    identity = [words["item"] for name, words in board.received(40_000) if name == "IDENTITY"]
    assert identity == [*range(len(identity) - 1), 65535]
    board.say("PARAM_GET", 0, 0)
    assert "PARAM_VALUE" in names(board.received())
    # 96 is the warning limit of a CAN controller (RM0008, EWGF of CAN_ESR).
    assert board.machine.can.tec < 96 and board.machine.can.rec < 96


def test_a_babbling_node_starves_can_and_nothing_else(board: CanBoard) -> None:
    """An identifier below everybody's: nothing else gets through, the loop and the UART go on."""
    board.open_uart()
    board.hello()
    board.received(5000)
    board.wire.babble(WireFrame(0x000, bytes(8)))
    board.received(1000)  # what was under way
    assert board.received(300_000) == []
    said = board.over_uart("PARAM_GET", 3, 0)
    assert ("PARAM_VALUE", 3) in [(name, words.get("index")) for name, words in said]
    assert board.machine.reset_count == 1
    board.machine.advance_us(2_000_000)
    board.wire.babble(None)
    board.received(10_000)
    board.hello()
    assert "IDENTITY" in names(board.received())


@pytest.mark.slow
def test_a_babbling_host_identifier_delays_no_step(board: CanBoard) -> None:
    """DISARM frames without a right checksum at full rate: counted, no step is missed."""
    board.open_uart()
    board.hello()
    board.over_uart("CHALLENGE", 18, 0)
    nonce = dict(board.over_uart("CHALLENGE", 18, 0))["NONCE"]["nonce"]
    board.over_uart("RUN_BEGIN", 18, nonce)
    before = board.machine.can.wire.frames_sent
    board.wire.babble(WireFrame(0x009, bytes(8)))
    said = board.over_uart("PARAM_GET", 0, 0, us=1_000_000)
    steps = [words["step"] for name, words in said if name == "STEP"]
    assert steps == list(range(steps[0], steps[0] + len(steps))) and len(steps) >= 49
    board.wire.babble(None)
    counters = dict(board.received(200_000))["COUNTERS"]
    assert counters["rejected"] > 3000
    assert board.machine.can.wire.frames_sent > before
    assert board.machine.reset_count == 1


def test_a_host_at_the_wrong_rate_is_ignored_and_does_no_harm(board: CanBoard) -> None:
    board.open_uart()
    board.wire.kbit = 250
    for _ in range(20):
        board.hello()
    assert board.received(100_000) == []
    health = board.health()
    assert health["receive_errors"] == 20 and health["last_error"] == STUFF
    board.wire.kbit = 500
    board.hello()
    assert "IDENTITY" in names(board.received())


def test_a_bus_held_dominant_and_released(board: CanBoard) -> None:
    board.open_uart()
    board.hello()
    board.received(5000)
    board.wire.short(True)
    board.received(1_000_000)
    assert board.health()["bus_offs"] == 1  # joining waits for recessive bits, and nothing else waits for that
    assert board.health()["bus_off"] == 1
    board.wire.short(False)
    board.received(100_000)
    board.hello()
    assert "IDENTITY" in names(board.received(50_000))
    assert board.machine.reset_count == 1


def test_never_on_the_bus_without_a_crystal() -> None:
    board = CanBoard(crystal=False)
    assert not board.machine.can.clocked
    board.hello()
    assert board.received(300_000) == []
    board.open_uart()
    status = [words for name, words in board.over_uart("PARAM_GET", 0, 0, us=110_000) if name == "STATUS"][-1]
    assert status["faults"] & FAULT_CLOCK_FALLBACK
    assert board.health()["bus_off"] == 1


def test_a_crystal_that_dies_takes_the_board_off_the_bus(board: CanBoard) -> None:
    board.hello()
    board.received()
    board.machine.rcc.kill_crystal()
    board.machine.advance_us(200_000)
    board.wire.pop_frames()
    board.hello()
    assert board.received(300_000) == []
    assert not board.machine.can.clocked


def test_a_burst_beyond_the_ring_is_lost_counted_and_reported(board: CanBoard) -> None:
    """A flood of requests whose answers lose the bus to it: the queue of replies fills, nothing more is taken in."""
    board.wire.kbit = 1000
    board.open_uart()
    board.commit(can_bitrate_kbit=1000)
    board.hello()
    board.received(60_000)
    board.say("CHALLENGE", 16, 0)
    board.say("RUN_BEGIN", 16, dict(board.received())["NONCE"]["nonce"])
    board.received()
    for _ in range(3000):
        board.say("EXECUTE", 0, 0)
    board.received(500_000)
    faults = [words["faults"] for name, words in board.received(300_000) if name == "STATUS"][-1]
    assert faults & FAULT_CAN_OVERRUN
    board.say("PARAM_GET", 1, 0)
    assert "PARAM_VALUE" in names(board.received())


@pytest.mark.slow
@pytest.mark.parametrize("how", ["reset pin", "power cut", "brown-out"])
def test_the_board_is_lost_in_the_middle_of_a_frame(how: str) -> None:
    """At any bit of its own or of another's: half a frame is nobody's, the others go on, and so does the board."""
    board, chance = CanBoard(), random.Random(how)
    machine = board.machine
    for _ in range(12):
        board.hello()
        board.received(chance.uniform(2_000, 4_000))
        if how == "reset pin":
            machine.reset()
        elif how == "brown-out":
            machine.brown_out()
        else:
            machine.power_cut()
            machine.advance_us(100)
            machine.power_on()
        board.received(BOOT_US)
    board.hello()
    assert "STATUS" in {name for name, _ in board.received(300_000)}
    assert machine.warnings == []
