"""A pilot arms a vehicle that flies by the switch of his transmitter, or by the sticks. What blocks him is named, and
once it is armed neither a host nor a formality stops it."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from plumb.errors import LinkError
from plumb.link.identity import NackError
from plumb.link.parameter_table import commit, read_table
from plumb.spec import crsf
from plumb.spec.parameter_file import by_name
from support.piloted_board import HOLD_S, LEVEL, NEUTRAL_HALFUS, OFF, ON, ONE_G, Field, turns

ONE_DPS = 16.4
LEANING = (0, 0, 0, 0, round(0.5 * ONE_G), round(0.866 * ONE_G))
TURNING = (0, 0, round(8 * ONE_DPS), 0, 0, ONE_G)
LATE, HARD, SENSOR, STALLED = 0x0002, 0x0004, 0x0040, 0x2000
NO_DATA = 5


@pytest.fixture
def field() -> Iterator[Field]:
    one = Field()
    yield one
    one.session.close()


def test_the_switch_arms_and_disarms_without_a_host(field: Field) -> None:
    field.leaves()
    field.passes(4.0)
    field.pilot(ON, 0.2)
    assert field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4, "neutral is held first"
    field.passes(HOLD_S)
    assert turns(field.pulses), "they idle"
    field.pilot(crsf.sticks(throttle=0.3, on=True), 0.2)
    assert all(2500 < pulse < 2800 for pulse in field.pulses)
    field.pilot(crsf.sticks(throttle=0.3), 0.05)
    assert not field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4
    field.pilot(OFF, 1.0)
    field.pilot(ON, HOLD_S + 0.2)
    assert field.board.armed, "again, in the same run"


def test_a_switch_that_is_on_from_the_start_has_to_be_switched_off_first() -> None:
    field = Field(ON)
    field.passes(5.0)
    assert not field.board.armed and field.missing == "the pilot's switch is on: switch the motors off first"
    field.pilot(OFF, 0.5)
    assert not field.missing
    field.pilot(ON, 0.2)
    assert field.board.armed


def test_an_accelerometer_at_its_rail_keeps_it_on_the_ground(field: Field) -> None:
    """The vertical that such a sensor shows may be far from the true one, and its variance shrinks all the same."""
    field.passes(4.0)
    assert not field.missing
    field.feels = (0, 0, 0, 0, 0, 32767)
    field.passes(0.5)
    assert "it moves" in field.missing
    field.pilot(ON, 0.3)
    assert not field.board.armed


def test_a_gesture_begins_anew_with_the_link(field: Field) -> None:
    """Link quality 0 between two halves: what was not seen is not held."""
    gesture = crsf.sticks(yaw=-1.0)
    field.session.close()
    by_sticks = Field(receiver=2)
    by_sticks.passes(4.0)
    by_sticks.pilot(gesture, 0.1)
    by_sticks.pilot(crsf.statistics(0) + gesture, 1.5)
    by_sticks.pilot(crsf.statistics(100) + gesture, 0.2)
    assert "switch is on" not in by_sticks.missing and not by_sticks.board.armed
    by_sticks.pilot(gesture, 1.0)
    assert by_sticks.board.armed, "held for a second, it arms"
    by_sticks.session.close()


def test_without_frames_from_the_receiver_nobody_may_arm() -> None:
    field = Field(b"")
    field.passes(4.0)
    assert field.missing == "no frames from the pilot's receiver"
    field.session.begin("REALTIME_LIVE")
    field.passes(3.0)
    with pytest.raises(LinkError, match="no frames from the pilot's receiver"):
        field.session.arm(ready_wait_s=0.0)
    field.pilot(OFF, 0.3)
    assert not field.missing
    field.pilot(b"", 0.2)
    assert "receiver" in field.missing, "100 ms after the last frame"
    field.pilot(OFF + crsf.statistics(0), 0.2)
    assert "receiver" in field.missing, "it has lost the transmitter"


def test_a_board_that_was_never_calibrated_is_not_armed_by_a_pilot_and_by_a_host_without_one() -> None:
    field = Field(calibrated=0)
    field.passes(4.0)
    assert field.missing == "the sensors were never calibrated: run plumb calibrate"
    field.pilot(ON, 0.3)
    assert not field.board.armed
    commit(field.session, {**by_name(read_table(field.session)), "receiver": 0})
    field.session.begin("REALTIME_LIVE")
    field.passes(2.0)
    field.session.arm()
    assert field.board.armed, "on the bench"


def test_a_receiver_that_comes_back_switched_on_does_not_arm(field: Field) -> None:
    field.passes(4.0)
    field.pilot(b"", 0.2)
    field.pilot(ON, 1.0)
    assert not field.board.armed and "switch the motors off first" in field.missing
    field.pilot(OFF, 0.2)
    field.pilot(ON, 0.2)
    assert field.board.armed


def leans(field: Field) -> None:
    field.feels = LEANING


def moves(field: Field) -> None:
    field.feels = TURNING


def throttle_up(field: Field) -> None:
    field.sends = crsf.sticks(throttle=0.2)


def lock(field: Field) -> None:
    field.board.switch(True)


def fault(field: Field) -> None:
    field.board.wires.faults = HARD


BLOCKS: dict[str, tuple[Callable[[Field], None], float, str]] = {
    "tilted": (leans, 5.0, "it is tilted too far"),
    "moving": (moves, 0.5, "it moves"),
    "throttle": (throttle_up, 0.5, "the setpoint is not 0"),
    "lock": (lock, 0.5, "locks out the pilot"),
    "fault": (fault, 0.5, ""),
}


@pytest.mark.parametrize("name", BLOCKS)
def test_what_keeps_the_pilot_from_arming_is_named_and_going_away_does_not_arm(field: Field, name: str) -> None:
    block, seconds, text = BLOCKS[name]
    field.passes(3.0)
    block(field)
    field.passes(seconds)
    assert text in field.missing
    field.pilot(crsf.sticks(throttle=0.2 if name == "throttle" else 0.0, on=True), 0.5)
    assert not field.board.armed
    field.board.switch(False)
    field.board.wires.faults, field.feels = 0, LEVEL
    field.pilot(ON, 4.0)
    assert not field.board.armed, "a vehicle that is set down does not arm by itself"
    field.pilot(OFF, 3.0)  # set down at once: with the rotors off the filter takes the new vertical at rest
    field.pilot(ON, 0.2)
    assert field.board.armed


def test_a_throttle_that_is_raised_before_the_rotors_turn_disarms(field: Field) -> None:
    field.passes(4.0)
    field.pilot(ON, 0.2)
    field.pilot(crsf.sticks(throttle=0.4, on=True), 0.1)
    assert not field.board.armed and "not ready" in field.why_disarmed


def test_the_lock_stops_nothing_that_is_armed(field: Field) -> None:
    field.arms()
    lock(field)
    field.passes(0.5)
    assert field.board.armed and turns(field.pulses)


@pytest.mark.parametrize("request_name", ["RUN_END", "RUN_BEGIN", "DISARM", "CLOSE", "HELLO"])
def test_no_request_of_a_host_without_a_nonce_disarms(field: Field, request_name: str) -> None:
    field.arms()
    session = field.session
    if request_name == "RUN_BEGIN":
        with pytest.raises(NackError) as refused:
            session.begin("REALTIME_LIVE")
        assert refused.value.reason == "ARMED" and "a pilot's switch holds it armed" in str(refused.value)
    elif request_name == "HELLO":
        session.send([session.frame("HELLO", 0, 12345)])
    elif request_name == "CLOSE":
        session.request("CLOSE", 0, 0)
        field.board.write(b"C\r")
    else:
        with pytest.raises(NackError) as refused:
            session.request(request_name, 0, 0)
        assert refused.value.reason == "ARMED"
    field.passes(0.5)
    assert field.board.armed and turns(field.pulses)


def test_a_host_disarms_with_a_nonce(field: Field) -> None:
    field.arms()
    field.session.disarm()
    field.passes(0.05)
    assert not field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4
    assert field.why_disarmed == "the host disarmed"
    field.passes(3.0)
    assert not field.board.armed, "the switch has to be off first"


def test_a_host_that_records_and_dies_does_not_matter(field: Field) -> None:
    field.passes(2.0)
    field.session.begin("REALTIME_LIVE")
    field.passes(4.0)
    field.pilot(ON, HOLD_S + 0.2)
    assert field.board.armed, "in the run of a host, too"
    field.session.end()
    field.leaves()
    field.passes(1.0)
    assert field.board.armed and turns(field.pulses)


def test_a_lost_sensor_is_left_to_the_step_which_stops_after_50_ms(field: Field) -> None:
    field.arms()
    field.pilot(crsf.sticks(throttle=0.3, on=True), 0.3)
    field.board.wires.gyro = NO_DATA
    field.passes(0.04)
    assert field.board.armed and field.session.telemetry["STATUS"]["faults"] & SENSOR, "reported, and still flown"
    field.passes(0.2)
    assert not field.board.armed and field.pulses == [NEUTRAL_HALFUS] * 4
    assert "no samples came" in field.why_disarmed


def test_an_accelerometer_that_is_lost_alone_leaves_the_pilot_in_control(field: Field) -> None:
    field.arms()
    field.pilot(crsf.sticks(throttle=0.3, on=True), 0.3)
    field.board.wires.accel = NO_DATA
    field.passes(3.0)
    assert field.board.armed and turns(field.pulses)
    assert field.session.telemetry["STATUS"]["faults"] & SENSOR
    field.board.wires.accel = 0
    field.passes(0.5)
    assert field.board.armed and not field.session.telemetry["STATUS"]["faults"] & SENSOR


def test_faults_that_end_a_run_on_the_bench_do_not_end_a_flight(field: Field) -> None:
    field.arms()
    field.board.wires.faults = HARD | LATE | SENSOR
    field.passes(0.3)
    assert field.board.armed and turns(field.pulses)
    field.board.wires.faults = STALLED
    field.passes(0.01)
    assert not field.board.armed


def test_steps_that_come_late_do_not_end_a_flight_and_steps_that_do_not_come_do(field: Field) -> None:
    field.arms()
    field.board.wires.turn_us = 6000
    field.passes(0.1)
    field.board.wires.turn_us = 0
    field.passes(0.1)
    assert field.board.armed and field.board.mcu.wires.resets == 0
    assert field.session.connect()["FAULTS"] & LATE


def test_a_receiver_lost_on_the_ground_disarms_and_is_named(field: Field) -> None:
    field.arms()
    field.pilot(b"", 0.3)
    assert not field.board.armed and "the receiver was lost" in field.why_disarmed
    field.pilot(ON, 1.0)
    assert not field.board.armed, "its switch has to be off first"


def test_on_the_ground_with_the_throttle_low_it_disarms_after_10_s(field: Field) -> None:
    field.arms()
    field.passes(9.0)
    assert field.board.armed
    field.passes(1.0)
    assert not field.board.armed and "with the throttle low" in field.why_disarmed


def test_the_sticks_arm_and_disarm_when_the_parameter_says_so() -> None:
    field = Field(receiver=2)
    field.passes(4.0)
    field.pilot(ON, 1.5)
    assert not field.board.armed, "channel 5 is not used"
    field.pilot(crsf.sticks(yaw=-1.0), 0.9)
    assert not field.board.armed, "not for 1 s yet"
    field.passes(0.3)
    field.pilot(OFF, HOLD_S)
    assert field.board.armed and turns(field.pulses)
    field.pilot(crsf.sticks(yaw=-1.0), 1.5)
    field.pilot(crsf.sticks(throttle=0.2, yaw=1.0), 1.5)
    assert field.board.armed, "the throttle is not low"
    field.pilot(crsf.sticks(yaw=1.0), 0.9)
    assert field.board.armed
    field.passes(0.3)
    assert not field.board.armed


def test_sticks_that_are_held_over_a_silence_begin_again() -> None:
    field = Field(receiver=2)
    field.passes(4.0)
    field.pilot(crsf.sticks(yaw=-1.0), 0.7)
    field.pilot(b"", 0.2)
    field.pilot(crsf.sticks(yaw=-1.0), 0.8)
    assert not field.board.armed
    field.passes(0.4)
    assert field.board.armed


def test_a_host_sets_saves_and_loads_although_the_board_runs_for_its_pilot(field: Field) -> None:
    field.passes(3.0)
    session = field.session
    assert session.telemetry["STATUS"]["mode"] == session.protocol["STATUS"].value("mode", "REALTIME")
    commit(session, {**by_name(read_table(session)), "arm_hold_ms": 700})
    session.execute("SAVE")
    steps = field.board.steps
    session.execute("LOAD")
    field.passes(1.5)
    assert field.board.steps < steps, "a new run has begun"
    field.passes(4.0)
    field.pilot(ON, 0.3)
    assert field.board.armed
    with pytest.raises(NackError) as refused:
        session.execute("SAVE")
    assert refused.value.reason == "BUSY" and field.board.armed


def test_without_the_parameter_a_pilots_switch_arms_nothing() -> None:
    field = Field(receiver=0)
    field.session.begin("REALTIME_LIVE")
    field.passes(4.0)
    field.pilot(ON, 1.0)
    assert not field.board.armed
