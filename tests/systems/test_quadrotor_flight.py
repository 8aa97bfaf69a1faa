"""`quadrotor` flown: the C integers in the loop with the physics, some seeds side by side, and what its plant gives."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from plumb.boards.fixed import FixedBoard
from plumb.boards.native.board import NativeBoard
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.judging.quadrotor import loops, plots
from plumb.judging.quadrotor.flown import Flown, fly
from plumb.physics.airframe import HUMMINGBIRD_X
from plumb.physics.sensors import Fault
from plumb.proof.runs import closed_loop
from plumb.spec import images
from plumb.systems.quadrotor import courses, quantise, scenarios
from plumb.systems.quadrotor.vehicle import ROTORS_ON, Vehicles
from plumb.tuning.loop_model import nearest_margins
from support.swept_roll import swept_roll

SEEDS = range(1000, 1004)
FLOWN, HELD, STOPPED = 0, 1, 3


@cache
def flown(name: str) -> Flown:
    return fly(name, SEEDS)


def spans(course: courses.Course) -> list[tuple[float, float]]:
    """Begin and end of all that happens, s."""
    return [(one.begin_s, one.end_s) for one in course.turns] + [(one.begin_s, one.end_s) for one in course.happenings]


@pytest.mark.parametrize("name", [name for name, course in courses.COURSES.items() if course.later_s])
def test_what_happens_comes_at_a_time_that_the_seed_draws(name: str) -> None:
    """Within the stated range, spread over it, and the same for the same seed; nothing else of a run changes."""
    written = courses.COURSES[name]
    runs = [courses.drawn(name, seed) for seed in range(40)]
    later = np.array([run.later_s for run in runs])
    assert (later >= 0.0).all() and (later < written.later_s).all() and np.ptp(later) > 0.8 * written.later_s
    assert [courses.drawn(name, seed) for seed in range(40)] == runs
    for run, by_s in zip(runs, later.tolist(), strict=True):
        assert spans(run) == [(begin_s + by_s, end_s + by_s) for begin_s, end_s in spans(written)]
        assert max((one.begin_s for one in run.happenings), default=0.0) < run.seconds - 1.0
    first, second = scenarios.scenario(name, 0, seconds=3.0), scenarios.scenario("calm", 0, seconds=3.0)
    assert np.array_equal(first.noise, second.noise) and np.array_equal(first.imu, second.imu)


def test_rotors_of_the_x_frame_are_where_the_mixer_has_them() -> None:
    """Front right, front left, rear left, rear right; more of the first and the third turns the body to the left."""
    x, y, _ = np.array(HUMMINGBIRD_X.rotors_m).T
    assert np.sign(x).tolist() == [1.0, 1.0, -1.0, -1.0]
    assert np.sign(y).tolist() == [-1.0, 1.0, 1.0, -1.0]
    for axis, row in zip(("roll", "pitch", "yaw"), HUMMINGBIRD_X.allocation()[1:], strict=True):
        assert np.sign(row).tolist() == loops.PATTERNS[axis].tolist(), axis
    with pytest.raises(AssertionError, match="inertia"):
        replace(HUMMINGBIRD_X, inertia_kgm2=(0.007, 0.008, 0.012)).turned(1.0)


def test_a_step_of_the_lean_arrives_and_goes_again() -> None:
    """What is asked of 40 seeds (20 +- 2 deg from 0.4 s on), on four of them."""
    flight, begin_s = flown("lean"), courses.ACTS_S
    held = flight.around(flight.lean_deg, begin_s + 0.4, begin_s + courses.LEAN_S)
    assert np.abs(held - courses.LEAN_DEG).max() < 2.0
    assert flight.around(flight.lean_deg, begin_s + courses.LEAN_S + 0.6).max() < 4.0, "twice the estimate's"


def test_upside_down_it_rights_itself() -> None:
    """Rolled by half a turn: level again after 2 s at most on these seeds, and it stays so."""
    flight, end_s = flown("overturned"), courses.COURSES["overturned"].turns[0].end_s
    assert flight.around(flight.lean_deg, end_s).max() > 150.0
    assert flight.around(flight.lean_deg, end_s + 2.1).max() < 5.0


def test_a_lost_receiver_is_held_then_stopped() -> None:
    flight, lost_s = flown("lost"), courses.COURSES["lost"].happenings[0].begin_s
    at = [flight.around(flight.phase, lost_s + wait_s)[0] for wait_s in (0.05, 0.6, 1.25)]
    assert [set(phases) for phases in at] == [{FLOWN}, {HELD}, {STOPPED}]
    assert not flight.rotor[-1].any()
    lost_m = courses.COURSES["lost"].begin_m - flight.around(flight.height_m, lost_s + 1.9)[0]
    assert (lost_m > 3.0).all(), "it falls"


def test_a_receiver_back_in_time_changes_nothing() -> None:
    flight = flown("heard-again")
    assert set(np.unique(flight.phase[flight.between(courses.ACTS_S, np.inf)])) == {FLOWN, HELD}
    assert np.abs(flight.height_m[flight.between(courses.ACTS_S, np.inf)] - courses.HEIGHT_M).max() < 0.5


@pytest.mark.parametrize(("name", "at_s", "on"), [("idle", 15.0, False), ("on-its-back", 6.0, False)])
def test_what_does_not_fly_is_stopped(name: str, at_s: float, on: bool) -> None:
    """10 s with the throttle low on the ground; 1 s on its back."""
    flight = flown(name)
    assert flight.rotor[flight.between(courses.REST_S + 0.5, courses.REST_S + 0.6)].all()
    assert bool(flight.rotor[flight.between(at_s + 0.2, np.inf)].any()) is on


def test_an_accelerometer_at_its_rail_is_flown_without() -> None:
    """One axis at 16 g for 5 s of the flight, then back."""
    begin_s, end_s = 6.0, 11.0
    flight = fly("calm", SEEDS, seconds=14.0, faults=(Fault("railed", 3, begin_s, end_s),))
    air = flight.between(begin_s, np.inf)
    assert set(np.unique(flight.phase[air])) == {FLOWN} and flight.rotor[air].all()
    # 1.3 deg of error and 0.4 of lean; where the rail is not beyond the limits, all four crash.
    assert flight.error_deg[air].max() < 2.0 and flight.lean_deg[air].max() < 2.0


def test_nothing_turns_before_the_switch() -> None:
    flight = flown("lean")
    assert not flight.rotor[flight.between(0.0, courses.REST_S)].any()
    assert flight.rotor[flight.between(courses.ACTS_S, np.inf)].all()


@pytest.mark.slow
@pytest.mark.parametrize("link", ["serial", "can"])
def test_a_flight_in_closed_loop_on_the_flash_image_is_the_model_bit_for_bit(link: str) -> None:
    """From rest to turning rotors, over CAN at rest: flights are golden vectors, and their frames those of a rest."""
    pytest.importorskip("unicorn")
    from plumb.boards.virtual import VirtualBoard

    try:
        find_image(images.running("quadrotor"))
    except UsageError as missing:
        pytest.skip(str(missing))
    run = scenarios.scenario("lean", 1000, seconds=5.6 if link == "serial" else 1.5)
    with VirtualBoard(link=link) as board:
        done = closed_loop(board, run, quantise.quantise(run.fit(scenarios.HUMMINGBIRD)))
    assert (done.verdict, done.mismatches) == ("pass", 0)
    assert len(done.inputs.raw) == run.steps
    assert link == "can" or done.board_words["rotor_q24_0"][-1] > 0, "they turn at the end"


def test_a_run_is_a_batch_of_one() -> None:
    """The same bits alone and among others: the plant of a run is that of the figures."""
    runs = [scenarios.scenario("calm", seed, seconds=6.0) for seed in (1, 2)]
    params = quantise.quantise(runs[0].fit(scenarios.HUMMINGBIRD))
    alone = closed_loop(FixedBoard(), runs[0], params)
    assert alone.mismatches == 0
    vehicles = Vehicles(runs)
    for step in range(10):
        if step:
            vehicles.advance(np.zeros((4, 2)))
        assert vehicles.counts()[0].tolist() == alone.inputs.raw[step, :6].tolist()


def test_the_plant_gives_the_receivers_throttle_and_switches() -> None:
    run = scenarios.scenario("calm", 3, seconds=6.0)
    plant = scenarios.plant(run, open_loop=True)
    plant.follow(4.9, {})
    before = plant.counts(4.9)
    assert (plant.setpoint(4.9), before[9] & ROTORS_ON) == (0, 0)
    plant.follow(5.5, {})
    after_it = plant.counts(5.5)
    assert plant.setpoint(5.5) == pytest.approx(0.44 * 32767, rel=0.1), "0.6 u^2 + 0.4 u = 0.29 of the full thrust"
    assert after_it[9] & ROTORS_ON
    assert 1 <= after_it[10] <= 255


def test_periods_are_whole_steps_of_the_physics() -> None:
    with pytest.raises(UsageError, match="steps of 1250 or 1000 us"):
        scenarios.scenario("calm", 1, period_us=1_100)


def test_it_flies_with_steps_of_a_millisecond() -> None:
    run = scenarios.scenario("calm", 1000, seconds=12.0, period_us=1_000)
    tuning = replace(scenarios.HUMMINGBIRD, period_us=1_000)
    done = closed_loop(NativeBoard(), run, quantise.quantise(run.fit(tuning)))
    figures = plots.metrics(done)
    flown_deg, *heights_m = (figures[name] or 0.0 for name in ("flown_rmse_deg", "height_least_m", "height_most_m"))
    assert 0.0 < flown_deg < 1.0
    assert 29.9 < min(heights_m) <= max(heights_m) < 30.1


def test_the_roll_loop_has_its_margins(tmp_path_factory: pytest.TempPathFactory) -> None:
    """45 deg, 8 dB, 30 ms are asked."""
    found = nearest_margins(*swept_roll(tmp_path_factory))
    assert found.phase_deg > 45.0
    assert min(found.gain_db, found.lower_gain_db) > 8.0
    assert found.delay_s > 0.030
