"""What a run has learned on the board's own sensors is kept by SAVE: the thrust of a hover of `quadrotor`."""

from __future__ import annotations

import pytest

from plumb.link.identity import NackError
from plumb.link.parameter_table import commit, read_table
from plumb.link.sample_codec import layout_of, sample_frames
from plumb.link.session import Session
from plumb.spec import crsf
from plumb.spec.parameter_file import by_name
from support.noise import with_noise
from support.piloted_board import HOLD_S, LEVEL, OFF, ON, PARAMS, PERIOD_S, Field

HOVER = "attitude.aid_hover_q15"
SET_Q15 = PARAMS.own()[HOVER]
SHARE, FULL_Q15 = 0.6, 32767


@pytest.fixture
def landed() -> Field:
    """After a flight with 0.6 of the throttle, where 0.44 was set: 1 g is felt, so this is the thrust of a hover."""
    field = Field()
    field.passes(4.0)
    field.pilot(ON, HOLD_S + 0.2)
    field.pilot(crsf.sticks(throttle=SHARE, on=True), 3.0)
    assert field.board.armed
    field.pilot(crsf.sticks(), 0.3)
    assert not field.board.armed
    return field


def saved(field: Field) -> int:
    """The parameter after SAVE and the next start."""
    field.session.execute("SAVE")
    field.session.close()
    field.board.mcu.power_off()
    field.board.mcu.power_on()
    field.session = Session.open(field.board)
    field.session.connect()
    return by_name(read_table(field.session))[HOVER]


def test_the_first_take_off_after_a_save_knows_the_hover(landed: Field) -> None:
    assert by_name(read_table(landed.session))[HOVER] == SET_Q15
    found = saved(landed)
    assert found == pytest.approx(SHARE * FULL_Q15, rel=0.03) and found != SET_Q15


def test_without_save_the_next_start_has_the_committed_value(landed: Field) -> None:
    landed.session.close()
    landed.board.mcu.power_off()
    landed.board.mcu.power_on()
    with Session.open(landed.board) as session:
        assert by_name(read_table(session))[HOVER] == SET_Q15


def test_a_value_that_is_set_after_the_flight_is_the_one_that_is_saved(landed: Field) -> None:
    changed = SET_Q15 - 1000
    commit(landed.session, {**by_name(read_table(landed.session)), HOVER: changed})
    assert saved(landed) == changed


def test_a_save_while_it_flies_is_refused() -> None:
    field = Field()
    field.arms()
    with pytest.raises(NackError, match="a run is on"):
        field.session.execute("SAVE")
    assert by_name(read_table(field.session))[HOVER] == SET_Q15


def test_samples_of_a_host_teach_nothing() -> None:
    """The same flight, but its samples come over the link."""
    field = Field()
    session, layout = field.session, layout_of("quadrotor")
    session.begin("REALTIME_INJECTED", frames=[])
    for step in range(round(7.0 / PERIOD_S)):
        time_s = step * PERIOD_S
        field.board.mcu.receiver_send(OFF if time_s < 4.0 else crsf.sticks(throttle=SHARE * (time_s > 4.3), on=True))
        session.send(sample_frames(session.protocol, step, with_noise(LEVEL, step, 6), layout=layout))
        session.receive(PERIOD_S)
    session.end()
    assert saved(field) == SET_Q15
