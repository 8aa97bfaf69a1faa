"""On a link that loses nothing the board drops nothing: long replies leave room for telemetry (flash image)."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs the extra virtual")

from plumb.boards.virtual import VirtualBoard
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.link.lockstep import Lockstep
from plumb.link.session import Session
from plumb.spec.parameters import control_part
from plumb.systems.turntable import scenarios as turntable
from support.pins import at_rest

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)

PAUSES_S = [0.0013 * n for n in range(25)]
"""Between two long answers: they meet the periodic telemetry in every phase."""


@pytest.fixture(params=["serial", "can"])
def session(request: pytest.FixtureRequest) -> Iterator[Session]:
    with VirtualBoard(link=request.param) as board:
        at_rest(board.machine)
        yield board.session
        assert board.machine.warnings == []


def listen(session: Session, seconds: float) -> None:
    end = session.clock() + seconds
    while (remaining := end - session.clock()) > 0:
        session.receive(remaining)


def assert_nothing_lost(session: Session) -> None:
    listen(session, 0.25)
    assert session.telemetry["COUNTERS"]["dropped"] == 0
    assert session.counters.lost == 0
    assert session.counters.repeated_requests == 0


@pytest.mark.slow
def test_reading_parameters_drops_no_telemetry(session: Session) -> None:
    for pause_s in PAUSES_S:
        session.read_parameters()
        listen(session, pause_s)
    assert_nothing_lost(session)


@pytest.mark.slow
def test_reading_parameters_in_a_live_run_drops_no_step(session: Session) -> None:
    session.upload(control_part(session.read_parameters()), period_us=2000)
    session.begin("REALTIME_LIVE", frames=("RAW_A", "QUAD_ANGLE"))
    for pause_s in PAUSES_S[::2]:
        session.read_parameters()
        listen(session, pause_s)
    assert_nothing_lost(session)
    session.end()


def test_all_words_of_a_step_in_lockstep_drop_no_telemetry(session: Session) -> None:
    session.upload(quantise(turntable.TUNINGS[turntable.DEFAULT_TUNING]).words())
    run = Lockstep(session, frames=("RAW_A", "TURNTABLE_ATTITUDE_W"), words=tuple(range(session.record_words)))
    for pause_s in PAUSES_S:
        run.exchange((1, 2, 3, 4, 5, 6), 0)
        listen(session, pause_s)
    session.end()
    assert_nothing_lost(session)
