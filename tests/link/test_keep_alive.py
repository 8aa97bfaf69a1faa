"""A host that falls silent loses the board: outputs safe within 50 ms and for good, whatever moves, however samples
come, over either link. Looked at on the pins of the virtual board."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import count, cycle, repeat
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb import systems
from plumb.boards.virtual_can import MachineBus
from plumb.contract.parameters import quantise
from plumb.errors import LinkError, UsageError
from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.machine import Machine
from plumb.flash.image import find_image
from plumb.link.sample_codec import sample_frames
from plumb.link.session import Session
from plumb.proof.faults.outputs import Watch
from plumb.spec import images, parameters
from plumb.spec.protocol import Frame
from support.balancer_bench import Balancer
from support.kept import as_made
from support.native_board import AT_REST
from support.noise import with_noise
from support.pins import at_rest

SAFE_US = 50_000
NEUTRAL_US = 1000.0
SILENCE = 1 << 5
LINKS = ["serial", "can"]
RUNS = ["REALTIME_LIVE", "REALTIME_INJECTED"]
RUNS_OVER_LINKS = [(run, link) for run in RUNS for link in LINKS]
"""Of system, run and link every pair is in `make test`, the whole product in `make test-long`."""
READY_US = 1_000_000
"""At rest from the first step on, a run may be armed by then."""
DRIVEN_US, LATCHED_US = 200_000, 250_000
"""Armed before the silence; and how long the outputs are looked at afterwards, with and without a host."""
QUAD_PERIOD_US, BALANCER_PERIOD_US = 5000, 10_000
CONTROL = [row.default for row in parameters.table() if row.owner == "control"]

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)


def long(case: tuple[object, ...]) -> object:
    return pytest.param(*case, marks=pytest.mark.long)


def opened(machine: Machine, link: str) -> Session:
    return Session.over(MachineBus(machine)) if link == "can" else Session.open(machine.uart)


def drive(session: Session, run: str, period_us: int, raw: tuple[int, ...]) -> Callable[[bool], None]:
    """Begin and arm; returns what lets one period pass: True with the host alive, False with samples alone."""
    session.begin(run)
    step = 0

    def one_period(alive: bool) -> None:
        nonlocal step
        if run == "REALTIME_INJECTED":
            session.frames.write_frames(sample_frames(session.protocol, step, with_noise(raw, step)))
            step += 1
        end = session.clock() + period_us * 1e-6
        while (remaining := end - session.clock()) > 0:
            if alive:
                session.receive(remaining)
            else:
                session.frames.read_frames(remaining)

    end_s = session.clock() + READY_US * 1e-6
    while session.clock() < end_s:
        one_period(True)
    session.arm()
    for _ in range(DRIVEN_US // period_us):
        one_period(True)
    return one_period


class Quad:
    """Armed and driving over a link, in a run of this kind."""

    def __init__(self, link: str, run: str) -> None:
        self.machine = Machine(find_image())
        at_rest(self.machine)
        self.machine.advance_us(30_000)
        self.session = opened(self.machine, link)
        self.session.upload(CONTROL, period_us=QUAD_PERIOD_US, arm_hold_ms=0)
        self.one_period = drive(self.session, run, QUAD_PERIOD_US, AT_REST)


def armed_quad(link: str, run: str) -> tuple[Machine, Session, Callable[[bool], None]]:
    quad = as_made(f"keep-alive {link} {run}", lambda: Quad(link, run))
    return quad.machine, quad.session, quad.one_period


def fall_silent(machine: Machine, one_period: Callable[[bool], None], safe: Callable[[], bool]) -> float:
    """How long after the host's last keep-alive the outputs are safe, to 0.1 ms; they must stay so."""
    assert not safe()
    watch = Watch(machine)
    watch.begin()
    while not safe():
        one_period(False)
        assert machine.now_us - watch.begun / TICKS_PER_US < 2 * SAFE_US
    end_us = machine.now_us + LATCHED_US
    while machine.now_us < end_us:
        one_period(False)
        assert safe()
    watch.end()
    assert watch.safe_ms is not None
    return 1000 * watch.safe_ms


def assert_latched(session: Session, one_period: Callable[[bool], None], safe: Callable[[], bool]) -> None:
    """A host that is back, keep-alives and all, moves nothing, and gets the reason."""
    end_s = session.clock() + LATCHED_US * 1e-6
    while session.clock() < end_s:
        one_period(True)
        assert safe()
    assert session.telemetry["STATUS"]["armed"] == 0
    assert session.telemetry["EVENTS"]["disarm_cause"] == SILENCE


@pytest.mark.slow
@pytest.mark.parametrize(("run", "link"), [RUNS_OVER_LINKS[0], *map(long, RUNS_OVER_LINKS[1:3]), RUNS_OVER_LINKS[3]])
def test_the_pulses_of_quad(link: str, run: str) -> None:
    machine, session, one_period = armed_quad(link, run)

    def safe() -> bool:
        return all(machine.pwm(pin).pulse_us == NEUTRAL_US for pin in ("PB6", "PB7"))

    assert fall_silent(machine, one_period, safe) < SAFE_US
    assert_latched(session, one_period, safe)
    assert machine.warnings == []


@pytest.mark.slow
@pytest.mark.parametrize(("run", "link"), [long(RUNS_OVER_LINKS[0]), *RUNS_OVER_LINKS[1:3], long(RUNS_OVER_LINKS[3])])
def test_the_bridge_of_balancer(link: str, run: str) -> None:
    balancer = Balancer.as_made(link)
    session = balancer.open()
    one_period = drive(session, run, BALANCER_PERIOD_US, (0, 20, 255, 0, 0, 0))
    assert fall_silent(balancer.machine, one_period, lambda: not balancer.driving) < SAFE_US
    assert_latched(session, one_period, lambda: not balancer.driving)
    assert balancer.machine.warnings == []


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("name", sorted(set(systems.SYSTEMS) - {"quad", "balancer"}))
def test_what_moves_nothing_cannot_be_armed(link: str, name: str) -> None:
    machine = Machine(find_image(Path(name) if name in images.left_out_of_all() else None))
    machine.advance_us(30_000)
    system = systems.load(name)
    session = opened(machine, link)
    session.upload(list(quantise(system.TUNINGS[system.DEFAULT_TUNING]).values.values()), period_us=system.PERIOD_US)
    session.begin("REALTIME_INJECTED")
    with pytest.raises(LinkError):
        session.arm()


# ---- frames that no living host sent ----

Frames = list[tuple[int, bytes]]


def recorded(session: Session, one_period: Callable[[bool], None], count: int) -> Frames:
    """The keep-alives of a living host, so many."""
    frames: Frames = []
    honest, identifier = session.frames.write_frames, session.protocol["KEEPALIVE"].identifier

    def note(sent: Sequence[Frame]) -> None:
        frames.extend(frame for frame in sent if frame[0] == identifier)
        honest(sent)

    session.frames.write_frames = note  # type: ignore[assignment]
    while len(frames) < count:
        one_period(True)
    session.frames.write_frames = honest  # type: ignore[method-assign]
    return frames[:count]


def last_one(session: Session, frames: Frames) -> Iterator[Frame]:
    """Byte for byte the same."""
    return repeat(frames[-1])


def in_turn(session: Session, frames: Frames) -> Iterator[Frame]:
    return cycle(frames)


def backwards(session: Session, frames: Frames) -> Iterator[Frame]:
    """The last first, with counters that go down."""
    message = session.protocol["KEEPALIVE"]
    for number, (identifier, data) in enumerate(cycle(reversed(frames))):
        yield identifier, message.pack(-number & 15, 0, *message.unpack(data)[2:])


def next_counters(session: Session, frames: Frames) -> Iterator[Frame]:
    """A sender that goes on with the counter and the value it had last, as a cyclic sender of an adapter does."""
    message = session.protocol["KEEPALIVE"]
    for number in count(1):
        yield frames[-1][0], message.pack(frames[-1][1][1] + number & 15, 0, *message.unpack(frames[-1][1])[2:])


REPLAYS = [(last_one, 1), (in_turn, 16), (in_turn, 256), (backwards, 16), (next_counters, 1)]
REPLAYED = [
    case if (number + fast + (link == "can")) % 2 else long(case)
    for number, replay in enumerate(REPLAYS)
    for fast, every_us in enumerate((15_000, 1000))
    for link in LINKS
    for case in [(*replay, every_us, link)]
]
"""Every pair of replay, pace and link; the others are long."""


@pytest.mark.slow
@pytest.mark.parametrize(("replay", "frames", "every_us", "link"), REPLAYED)
def test_a_sender_that_goes_on_while_the_host_hangs_keeps_nothing_alive(
    link: str, replay: Callable[[Session, Frames], Iterator[Frame]], frames: int, every_us: int
) -> None:
    """The host freezes; what it sent before is sent again and again, as a driver, an adapter or a recorder would."""
    machine, session, one_period = armed_quad(link, "REALTIME_LIVE")
    again = replay(session, recorded(session, one_period, frames))
    begin_us, armed = machine.now_us, True
    while armed:
        session.frames.write_frames([next(again)])
        end = session.clock() + every_us * 1e-6
        while session.clock() < end:
            session.frames.read_frames(min(end - session.clock(), 0.001))
            neutral = all(machine.pwm(pin).pulse_us == NEUTRAL_US for pin in ("PB6", "PB7"))
            armed = armed and not neutral
        assert machine.now_us - begin_us < SAFE_US + every_us
    for _ in range(60):
        session.frames.write_frames([next(again)])
        session.frames.read_frames(every_us * 1e-6)
        assert all(machine.pwm(pin).pulse_us == NEUTRAL_US for pin in ("PB6", "PB7"))


@pytest.mark.slow
@pytest.mark.parametrize("link", LINKS)
def test_what_is_stuck_in_a_buffer_holds_it_for_90_ms_at_most(link: str) -> None:
    """The worst that a driver can do with a host that hangs: each answer is let out when it is about to be too old."""
    machine = Machine(find_image())
    at_rest(machine)
    machine.advance_us(30_000)
    session = opened(machine, link)
    session.upload(CONTROL, period_us=QUAD_PERIOD_US, esc_period_us=2500, arm_hold_ms=0)
    drive(session, "REALTIME_LIVE", QUAD_PERIOD_US, ())
    value = session.protocol["KEEPALIVE_VALUE"].identifier
    stuck: Frames = []
    issued_us = machine.now_us
    while not stuck:
        for identifier, data in session.frames.read_frames(0.001):
            if identifier == value:
                issued_us = machine.now_us
                stuck = [session.frame("KEEPALIVE", *session.protocol["KEEPALIVE_VALUE"].unpack(data)[2:])]
    hung_us = machine.now_us  # here the host hangs; its last answer is in the driver
    while machine.now_us - issued_us < 25_000:
        session.frames.read_frames(0.0005)
    session.frames.write_frames(stuck)
    while any(machine.pwm(pin).pulse_us != NEUTRAL_US for pin in ("PB6", "PB7")):
        session.frames.read_frames(0.0005)
        assert machine.now_us - hung_us < 90_000
    assert machine.now_us - hung_us > 55_000  # the frame did count
