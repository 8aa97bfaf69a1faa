"""In real time a setpoint counts by the step number that it carries: what repeats recorded setpoints is silence, and a
living host keeps its setpoint at every period, over both links, without STEPs, and while the clock wraps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import cycle

import can
import pytest

from plumb.link.session import Session
from plumb.link.transports.slcan import SlcanParser, text_of_frames
from plumb.spec.protocol import Frame, protocol
from support.native_board import UartBoard
from support.sessions import CONTROL, STEER, listen, refusal

LINKS = ("serial", "can")
TIMED_OUT_US = (200_000, 225_000)
"""After the last setpoint that counted: the time-out, and a step of 20 ms at most."""


class Driven:
    """A board that drives, armed over a link, and the SETPOINT_USED that its host receives."""

    def __init__(self, link: str, period_us: int = 5000, time_us: int = 0) -> None:
        self.board = UartBoard(time_us=time_us)
        self.board.run_us(30_000)
        bus = self.board.can_bus()
        self.session = Session.over(bus) if link == "can" else Session.open(self.board)
        self.session.upload(CONTROL, period_us=period_us, esc_period_us=2500, arm_hold_ms=0)
        self.session.begin("REALTIME_LIVE")
        self.session.arm(ready_wait_s=30.0)
        self.used: list[tuple[int, dict[str, int]]] = []
        self.sent: list[Frame] = []
        self.session.listener = self._note
        self._write = self.session.frames.write_frames
        self.session.frames.write_frames = self._record  # type: ignore[method-assign]

    def _note(self, frames: list[Frame]) -> None:
        message = protocol()["SETPOINT_USED"]
        self.used += [(self.board.time_us, message.decode(data)) for name, data in frames if name == message.identifier]

    def _record(self, frames: Sequence[Frame]) -> None:
        self.sent += [frame for frame in frames if frame[0] == protocol()["SETPOINT"].identifier]
        self._write(frames)

    def hang(self) -> None:
        """The source of setpoints says nothing any more; the keep-alives go on."""
        self.session.setpoint.stop()

    def close(self) -> None:
        self.session.close()


Drive = Callable[..., Driven]


@pytest.fixture
def driven() -> Iterator[Drive]:
    made: list[Driven] = []

    def make(link: str, period_us: int = 5000, time_us: int = 0) -> Driven:
        made.append(Driven(link, period_us, time_us))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("count", [1, 2, 16])
def test_repeated_setpoints_are_silence(driven: Drive, link: str, count: int) -> None:
    board = driven(link)
    board.session.set_setpoint(STEER)
    listen(board.session, 1.0)
    recorded = board.sent[-count:]
    assert len(recorded) == count
    board.hang()
    begin_us = board.board.time_us
    board.used.clear()
    for frame in cycle(recorded):
        board.session.frames.write_frames([frame])
        listen(board.session, 0.02)
        if board.board.time_us - begin_us > 1_000_000:
            break
    assert [(said["setpoint"], said["timed_out"]) for _, said in board.used] == [(0, 1)]
    assert TIMED_OUT_US[0] - 60_000 < board.used[0][0] - begin_us < TIMED_OUT_US[1]
    assert board.board.armed


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("period_us", [500, 1000, 20_000])
def test_a_living_host_keeps_its_setpoint_at_every_period(driven: Drive, link: str, period_us: int) -> None:
    board = driven(link, period_us)
    board.session.set_setpoint(STEER)
    listen(board.session, 2.0)
    board.session.set_setpoint(-STEER)
    board.session.set_setpoint(STEER // 2)  # at once after it: the last one counts
    listen(board.session, 2.0)
    assert not any(said["timed_out"] for _, said in board.used)
    assert board.used[0][1]["setpoint"] == STEER and board.used[-1][1]["setpoint"] == STEER // 2


def test_a_host_that_receives_no_step_keeps_its_setpoint_by_time(driven: Drive) -> None:
    """A link that drops every STEP: TIME comes 20 times a second."""
    board = driven("serial")
    step = protocol()["STEP"].identifier

    def without_steps(data: bytes) -> bytes:
        return text_of_frames([frame for frame in SlcanParser().feed(data) if frame[0] != step])

    board.board.spoil_up = without_steps
    board.session.set_setpoint(STEER)
    listen(board.session, 2.0)
    assert {said["setpoint"] for _, said in board.used} == {STEER}
    assert not any(said["timed_out"] for _, said in board.used)
    assert board.board.armed


@pytest.mark.parametrize("link", LINKS)
def test_old_and_coming_numbers_are_refused_by_name(driven: Drive, link: str) -> None:
    board = driven(link)
    session = board.session
    session.set_setpoint(STEER)
    listen(session, 0.5)
    board.used.clear()
    next_step = session.setpoint.next_step
    tag = session.run_tag
    for number in (next_step - 20, next_step - 300, next_step + 100, next_step + 0x8000):
        asked = partial(session.request, "SETPOINT", number & 0xFFFF, 1, flags=tag)
        assert refusal(asked) == "SEQUENCE"
    listen(session, 0.1)
    assert {said["setpoint"] for _, said in board.used} <= {STEER}


@pytest.mark.parametrize("link", LINKS)
def test_a_setpoint_on_its_way_while_the_board_disarms_does_not_act_afterwards(driven: Drive, link: str) -> None:
    """It had stayed for ever: an unarmed board waits for no setpoint, and its host says none any more."""
    board = driven(link)
    session = board.session
    session.set_setpoint(STEER)
    listen(session, 0.5)
    late = session.setpoint_frames(2 * STEER)
    board.board.sensors(faults=1)
    board.board.run_us(3000)
    assert not board.board.armed
    board.used.clear()
    session.frames.write_frames(late)
    listen(session, 0.3)
    assert [said["setpoint"] for _, said in board.used] == [0]
    session.set_setpoint(0)
    session.setpoint.say(STEER, repeats=False)  # sent after the end was received: an unarmed run has setpoints, too
    listen(session, 0.1)
    assert [said["setpoint"] for _, said in board.used][-1] == STEER


@pytest.mark.parametrize("link", LINKS)
def test_the_clock_wraps_while_armed(driven: Drive, link: str) -> None:
    """After 71.6 minutes: nothing is let go, and nothing is held beyond its time."""
    board = driven(link, time_us=(1 << 32) - 2_500_000)
    board.session.set_setpoint(STEER)
    listen(board.session, 2.5)
    assert board.board.time_us > 1 << 32
    assert board.board.armed and not any(said["timed_out"] for _, said in board.used)
    begin_us = board.board.time_us
    while board.board.armed:
        board.board.run_us(500)
        assert board.board.time_us - begin_us < 50_000


@pytest.mark.parametrize("before_us", [5000, 25_000, 100_000])
def test_time_outs_across_the_wrap_of_the_clock(driven: Drive, before_us: int) -> None:
    """A source, then the host, fall silent a little before the clock wraps."""
    board = driven("serial", time_us=(1 << 32) - 2_500_000)
    board.session.set_setpoint(STEER)
    while board.board.time_us < (1 << 32) - before_us:
        board.session.receive(0.002)
    board.hang()
    begin_us = board.board.time_us
    listen(board.session, 0.4)
    assert [said["setpoint"] for _, said in board.used if said["timed_out"]] == [0]
    assert TIMED_OUT_US[0] - 60_000 < board.used[-1][0] - begin_us < TIMED_OUT_US[1]
    other = driven("serial", time_us=(1 << 32) - 2_500_000)
    while other.board.time_us < (1 << 32) - before_us:
        other.session.receive(0.002)
    begin_us = other.board.time_us
    while other.board.armed:
        other.board.run_us(500)
        assert other.board.time_us - begin_us < 50_000


def test_a_storm_of_parameters_over_the_other_link_disturbs_no_armed_run(driven: Drive) -> None:
    """PARAM_SET, PARAM_GET and PARAM_COMMIT as fast as the bus takes them, half a table of another host among them."""
    board = driven("serial")
    bus = board.board.can_bus()
    other = Session.over(bus)
    board.session.set_setpoint(STEER)
    before = board.session.read_parameters()
    steps = board.board.steps
    for turn in range(300):
        other.frames.write_frames(
            [
                other.frame("PARAM_SET", turn % 100, before[turn % 100] & 0xFFFFFFFF),
                other.frame("PARAM_GET", 0xFFFF, 0),
                other.frame("PARAM_COMMIT", len(before), turn),
            ]
        )
        board.session.receive(0.003)
        other.frames.read_frames(0.0)
    assert board.board.armed and not any(said["timed_out"] for _, said in board.used)
    assert (board.board.steps - steps) & 0xFFFF > 150
    assert board.session.read_parameters() == before
    can.BusABC.shutdown(bus)
