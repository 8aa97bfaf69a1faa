"""`turntable` on the whole flash image: both sensors on six analog inputs, and what comes of one that fails."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("unicorn")

from plumb.boards.virtual import VirtualBoard
from plumb.cli.monitor_line import line
from plumb.contract import disturbance
from plumb.contract.parameters import quantise
from plumb.errors import LinkError, UsageError
from plumb.link.monitor import Monitor, begin_live
from plumb.physics.sensors import ADC_COUNTS, ADC_REFERENCE_V
from plumb.proof import live_run
from plumb.proof.runs import Run
from plumb.systems.turntable import pins as turntable_live
from plumb.systems.turntable import scenarios as turntable

PARAMS = quantise(turntable.TUNINGS["analog"])
AT_ONCE = turntable.with_fusion(turntable.TUNINGS["analog"], rest_s=0.1, lag_s=0.0)
HALF_V, DPS_V = ADC_REFERENCE_V / 2.0, ADC_REFERENCE_V / ADC_COUNTS * turntable.ADC_LSB_PER_DPS
ANGULAR = 8


@pytest.fixture(scope="module")
def inputs() -> Iterator[tuple[VirtualBoard, Run]]:
    with VirtualBoard() as board:
        yield board, live_run.run_live(board, turntable.scenario("analog", 1000, seconds=11.0), PARAMS)


@pytest.mark.slow
def test_a_live_run_is_the_model_bit_for_bit_and_knows_the_attitude(inputs: tuple[VirtualBoard, Run]) -> None:
    board, trial = inputs
    found = trial.metrics()
    assert trial.verdict == "pass" and found["target_vs_fixed_mismatches"] == 0
    assert found["angle_max_deg"] is not None and found["angle_max_deg"] < 0.5
    assert not board.machine.warnings


def test_the_converter_gives_what_the_sensors_give(inputs: tuple[VirtualBoard, Run]) -> None:
    """Six channels in their places, every count of the scenario."""
    _, trial = inputs
    sent, steps = turntable.scenario("analog", 1000, seconds=11.0).counts(), len(trial.inputs.raw) - 10
    agree = [np.mean(trial.inputs.raw[:steps] == sent[first : first + steps]) for first in range(10)]
    assert max(agree) == 1.0


@pytest.mark.long
def test_a_sensor_that_hangs_is_lost_and_the_run_goes_on() -> None:
    """The board marks the channels of the angular accelerometer 0.1 s after they stop to move, until they do again."""
    asked = turntable.faults([disturbance.parse("stuck:angular@10.2-11")])
    with VirtualBoard() as board:
        trial = live_run.run_live(board, turntable.scenario("analog", 1001, seconds=11.2, faults=asked), PARAMS)
    lost = np.flatnonzero(trial.inputs.raw[:, 3] == turntable.NO_SAMPLE)
    assert 165 <= len(lost) <= 185 and np.all(np.diff(lost) == 1)
    assert not (trial.words["flags"][lost] & ANGULAR).any() and trial.verdict == "pass"
    worst_deg = trial.metrics()["angle_max_deg"]
    assert worst_deg is not None and worst_deg < 5.0


def test_the_monitor_shows_attitude_and_rates() -> None:
    """Turning at 30 deg/s about x since 0.2 s: about 15 deg of roll after 0.7 s."""
    with VirtualBoard() as board:
        session, machine = board.session, board.machine
        session.upload(quantise(AT_ONCE).words(), period_us=turntable.PERIOD_US)
        begin_s = machine.now_us * 1e-6
        for index, pin in enumerate(turntable_live.ADC_PINS):
            machine.adc[pin] = lambda t_s, x=index == 0: (  # type: ignore[misc]
                HALF_V + DPS_V * (30.0 * (x and t_s > begin_s + 0.2) + math.sin(1e4 * t_s))
            )
        begin_live(session)
        monitor = Monitor(session)
        while machine.now_us * 1e-6 < begin_s + 0.7:
            monitor.feed(session.receive(0.05))
        seen = monitor.snapshot()
        text = line(seen)
        session.end()
    assert np.linalg.norm(seen["attitude"]) == pytest.approx(1.0, abs=1e-3)
    assert seen["rates_dps"] == pytest.approx([30.0, 0.0, 0.0], abs=2.0)
    roll = re.search(r"  roll ([+-][\d.]+) deg", text)
    assert roll and float(roll[1]) == pytest.approx(15.0, abs=2.0)


def test_only_the_scenario_of_the_pins_is_put_on_them() -> None:
    with VirtualBoard() as board, pytest.raises(UsageError, match="take the scenario and the tuning analog"):
        live_run.run_live(board, turntable.scenario("motion", 1000, seconds=2.0), PARAMS)


def test_it_drives_nothing_and_is_never_armed() -> None:
    with VirtualBoard() as board:
        board.session.upload(PARAMS.words(), period_us=turntable.PERIOD_US)
        board.session.begin("REALTIME_INJECTED")
        with pytest.raises(LinkError, match="pins"):
            board.session.arm()
