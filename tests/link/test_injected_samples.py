"""Injected samples in real time: old ones and dead channels disarm by name, and honest ones that get lost do not."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from plumb.errors import LinkError
from plumb.link.sample_codec import sample_frames
from plumb.link.session import Session
from support.native_board import AT_REST, UartBoard
from support.noise import with_noise
from support.sessions import CONTROL

SAMPLES, FAULT, IMPLAUSIBLE = 1 << 7, 1 << 3, 1 << 11
RAIL_0, STUCK_0, STUCK_ALL = 1, 1 << 8, 7 << 8
READY_US = 1_200_000
SAFE_US, NOTICED_US = 50_000, 500_000
FRAME_US, TURN_US = 2500, 1000
Counts = Callable[[int], tuple[int, ...]]
NEUTRAL = 2000


def honest(number: int) -> tuple[int, ...]:
    return with_noise(AT_REST[:3], number)


class Source:
    """A board and the source of its samples. number: of the next one."""

    def __init__(self, period_us: int, **words: int) -> None:
        self.board, self.period_us, self.number = UartBoard(), period_us, 0
        self.session = Session.open(self.board)
        self.session.upload(CONTROL, period_us=period_us, arm_hold_ms=0, esc_period_us=FRAME_US, **words)
        self.session.begin("REALTIME_INJECTED")

    def wait(self, time_us: int) -> None:
        """Let time pass, and answer keep-alives."""
        end_us = self.board.time_us + time_us
        while self.board.time_us < end_us:
            self.session.receive(min(1000, end_us - self.board.time_us) * 1e-6)

    def send(self, counts: Counts = honest, *, number: int | None = None, every_us: int = 0) -> None:
        """One sample, and a period of time."""
        at = self.number if number is None else number
        self.session.frames.write_frames(sample_frames(self.session.protocol, at, counts(at)))
        self.number = at + 1
        self.wait(every_us or self.period_us)

    def lose(self, samples: int) -> None:
        self.number += samples
        self.wait(samples * self.period_us)

    def armed(self) -> Source:
        for _ in range(READY_US // self.period_us):
            self.send()
        self.session.arm()
        for _ in range(100_000 // self.period_us):
            self.send()
        assert self.board.armed
        return self

    def drives(self) -> bool:
        return set(self.board.pulses) != {NEUTRAL}

    def cause(self) -> int:
        """Why it disarmed."""
        for _ in range(150_000 // self.period_us):
            self.send()
        return int(self.session.telemetry["EVENTS"]["disarm_cause"])

    def until_disarmed(self, act: Callable[[], None], limit_us: int) -> None:
        begin_us = self.board.time_us
        while self.board.armed:
            assert self.board.time_us - begin_us <= limit_us, "it drives on"
            act()
        assert not self.drives()


def circle(source: Source, length: int, every_us: int = 0) -> Callable[[], None]:
    """Its last samples, over and over."""
    end, sent = source.number, iter(range(1 << 30))
    return lambda: source.send(number=end - length + next(sent) % length, every_us=every_us)


@pytest.mark.parametrize("period_us", [1000, 5000])
@pytest.mark.parametrize("length", [1, 2, 16, 31, 32])
def test_a_circle_of_up_to_32_ends_as_silence_does(period_us: int, length: int) -> None:
    source = Source(period_us).armed()
    source.until_disarmed(circle(source, length, every_us=min(period_us, 5000)), SAFE_US - FRAME_US)
    assert source.cause() == SAMPLES


def test_silence_itself_ends_as_early() -> None:
    source = Source(5000).armed()
    source.until_disarmed(lambda: source.wait(1000), SAFE_US - FRAME_US)
    assert source.cause() == SAMPLES


@pytest.mark.parametrize("length", [33, 34, 40, 47])
def test_a_circle_of_33_to_47_loses_too_many(length: int) -> None:
    """Each time it comes round, 65 less its length numbers are ahead: from a quarter on that is too much."""
    source = Source(5000).armed()
    source.until_disarmed(circle(source, length), 1_200_000)
    assert source.cause() == SAMPLES


@pytest.mark.parametrize("length", [48, 55, 63, 64])
def test_a_circle_of_48_to_64_repeats_its_counts(length: int) -> None:
    source = Source(1000).armed()
    source.until_disarmed(circle(source, length), 150_000)
    assert source.cause() == SAMPLES


@pytest.mark.parametrize("every_us", [17_000, 33_000])
def test_one_sample_again_and_again_is_no_gap_of_64(every_us: int) -> None:
    """At 2 kHz 64 numbers are 32 ms: the same number after 32 ms may be an honest one."""
    source = Source(500).armed()
    last = source.number - 1
    source.until_disarmed(lambda: source.send(number=last, every_us=every_us), 600_000)
    assert source.cause() in (SAMPLES, FAULT)


@pytest.mark.parametrize("period_us", [500, 1000, 2000])
@pytest.mark.parametrize("gap_us", [5000, 16_000, 17_000, 20_000, 31_500, 32_000, 33_000, 40_000])
def test_an_honest_gap_stays_armed(period_us: int, gap_us: int) -> None:
    source = Source(period_us).armed()
    for _ in range(3):
        source.lose(gap_us // period_us)
        for _ in range(300_000 // period_us):
            source.send()
            assert source.board.armed
    assert source.session.telemetry["EVENTS"]["disarm_cause"] == 0


@pytest.mark.parametrize(("period_us", "lost", "of"), [(500, 7, 32), (1000, 3, 13), (5000, 1, 5), (20_000, 2, 14)])
def test_honest_loss_below_the_bound_stays_armed(period_us: int, lost: int, of: int) -> None:
    source = Source(period_us).armed()
    for number in range(3_000_000 // period_us):
        if number % of < lost:
            source.lose(1)
        else:
            source.send()
        assert source.board.armed


def test_loss_above_the_bound_disarms() -> None:
    """Every third sample is lost."""
    source = Source(1000).armed()

    def act() -> None:
        source.lose(1)
        source.send()
        source.send()

    source.until_disarmed(act, 500_000)
    assert source.cause() == SAMPLES


def test_old_samples_do_not_let_it_be_armed() -> None:
    source = Source(5000)
    for _ in range(READY_US // 5000):
        source.send()
    for _ in range(20):
        source.send(number=5)
    with pytest.raises(LinkError, match="old ones"):
        source.session.arm()
    assert not source.board.armed


def held(channel: int, count: int) -> Counts:
    def counts(number: int) -> tuple[int, ...]:
        raw = list(honest(number))
        raw[channel] = count
        return tuple(raw)

    return counts


@pytest.mark.parametrize("period_us", [500, 1000, 2000, 5000, 20_000])
@pytest.mark.parametrize(
    ("counts", "signal"),
    [
        (held(0, 1676), STUCK_0), (held(2, 3041), STUCK_0 << 2), (lambda _number: AT_REST[:3], STUCK_ALL),
        (held(0, 4095), RAIL_0), (held(0, 0), RAIL_0), (held(1, 0), RAIL_0 << 1),
    ],
    ids=["gyro stuck", "z stuck", "all stuck", "gyro high", "gyro low", "y low"],
)  # fmt: skip
def test_a_dead_channel_disarms_by_name(period_us: int, counts: Counts, signal: int) -> None:
    source = Source(period_us).armed()
    source.until_disarmed(lambda: source.send(counts), NOTICED_US - FRAME_US - TURN_US)
    for _ in range(150_000 // period_us):
        source.send(counts)
    assert source.session.telemetry["EVENTS"]["disarm_cause"] & (FAULT | SAMPLES)  # all stuck: a circle, too
    said = source.session.telemetry["SENSORS"]
    assert said["analog"] & signal == signal and said["injected"] == 1
    with pytest.raises(LinkError, match="injected channel"):
        source.session.arm()


@pytest.mark.parametrize("period_us", [500, 5000, 20_000])
@pytest.mark.parametrize("limit_ms", [20, 100])
@pytest.mark.parametrize("counts", [held(0, 1676), held(0, 4095)], ids=["stuck", "high"])
def test_whatever_an_armed_board_takes_as_limits_it_disarms_in_time(
    period_us: int, limit_ms: int, counts: Counts
) -> None:
    """A longer stuck_ms or rail_ms is refused with ARM: tests/link/test_unsafe_parameters.py."""
    source = Source(period_us, stuck_ms=limit_ms, rail_ms=limit_ms).armed()
    source.until_disarmed(lambda: source.send(counts), NOTICED_US - FRAME_US - TURN_US)
    assert source.cause() & (FAULT | IMPLAUSIBLE)  # while the filter's gain is high the innovation is found first


def test_implausible_counts_disarm() -> None:
    """1.6 g along y, with noise."""
    source = Source(5000).armed()
    source.until_disarmed(lambda: source.send(lambda number: with_noise((1676, 3600, 3041), number)), NOTICED_US)
    assert source.cause() & IMPLAUSIBLE


def test_a_fault_of_injected_counts_ends_with_it() -> None:
    source = Source(5000)
    for _ in range(100):
        source.send(held(0, 1676))
    assert source.session.telemetry["STATUS"]["faults"] & 1 << 6
    source.armed()


def test_a_period_that_cannot_meet_500_ms_blocks_by_name() -> None:
    """20 equal counts and one more are 0.42 s at 20 ms."""
    slow = Source(20_001)
    for _ in range(80):
        slow.send()
    with pytest.raises(LinkError, match="period_us"):
        slow.session.arm()
