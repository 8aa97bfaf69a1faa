"""The course of a three-axis calibration: what a hand does wrong is refused, and the result is that of the part."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from plumb import systems
from plumb.calibration import vector_calibration
from plumb.calibration.axis_calibration import Calibrated, Calibration
from plumb.calibration.vector_calibration import VectorCalibration, calibration_of
from plumb.contract.parameters import quantise
from plumb.errors import UsageError, VerdictError
from plumb.physics.hand import TurningHand
from plumb.spec import declarations
from plumb.systems.attitude import poses
from plumb.systems.attitude.held import HeldBody
from plumb.systems.contracts import PINS, POSES
from plumb.tuning.pose_calibration import Pose

PERIOD_US = 20_000
SEED = 7


class Bench:
    """A board without a board: the counts of a body in a hand, on a clock that only readings move on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, name: str = "attitude") -> None:
        plant, hand = systems.load(name, POSES).held(SEED)
        assert isinstance(hand, TurningHand) and isinstance(plant, HeldBody)
        self.plant, self.hand, self.now_s, self.ended = plant, hand, 0.0, 0
        self.spoil: Callable[[list[tuple[int, ...]]], list[tuple[int, ...]]] = lambda samples: samples
        control = quantise(systems.load(name).TUNINGS[systems.load(name, PINS).TUNING])
        table = {**control.values, "system": declarations.system(name).number, "period_us": PERIOD_US}
        monkeypatch.setattr("plumb.link.parameter_table.read_table", lambda session: [])
        monkeypatch.setattr(vector_calibration, "by_name", lambda rows: table)
        monkeypatch.setattr(vector_calibration, "require_sensors", lambda session: None)
        monkeypatch.setattr("plumb.link.raw_capture.begin", lambda session, channels: None)
        monkeypatch.setattr("plumb.link.raw_capture.counts", self.counts)

    def counts(self, session: object, channels: Mapping[str, int], seconds: float) -> dict[str, list[int]]:
        taken = []
        for _ in range(round(seconds * 1e6 / PERIOD_US)):
            self.now_s += PERIOD_US * 1e-6
            taken.append(self.plant.counts(self.now_s))
        taken = self.spoil(taken)
        return {name: [sample[number] for sample in taken] for name, number in channels.items()}

    def require_match(self) -> None: ...

    def end(self) -> None:
        self.ended += 1


class Clumsy:
    """Holds the body; what is done wrong, by the number of the request, is done once."""

    def __init__(self, bench: Bench, wrong: dict[int, Callable[[], None]], patience: int = 9) -> None:
        self.bench, self.wrong, self.refusals, self.asked, self.patience = bench, wrong, list[str](), 0, patience
        self.poses: list[str] = []

    def place(self, pose: Pose) -> None:
        self.bench.spoil = lambda samples: samples
        self.asked += 1
        self.poses.append(pose.name)
        self.wrong.pop(self.asked, lambda: self.bench.hand.put(pose.name))()

    def turn(self, text: str, end: Pose) -> None:
        self.place(end)

    def refused(self, reason: str) -> None:
        self.refusals.append(reason)
        if len(self.refusals) > self.patience:
            raise VerdictError(reason)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def calibrate(bench: Bench, **wrong: Callable[[], None]) -> tuple[Calibrated, Clumsy]:
    clumsy = Clumsy(bench, {int(number[1:]): action for number, action in wrong.items()})
    session: Any = bench
    calibration = calibration_of(session)
    assert isinstance(calibration, VectorCalibration)
    return calibration.run(clumsy), clumsy


@pytest.mark.parametrize("name", ["attitude", "quadrotor"])
def test_the_result_is_that_of_the_part(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(monkeypatch, name)
    found, clumsy = calibrate(bench)
    assert (clumsy.refusals, clumsy.asked, bench.ended) == ([], 13, 1)
    there, back = ["left side up", "front up", "level"], ["front up", "left side up", "level"]
    assert clumsy.poses == [*(pose.name for pose in poses.POSES), "level", *there, *back]
    after = {**found.table, **found.words}
    gyro, accel = poses.sensors_of(after)
    errors = bench.plant.errors
    # As in tests/tuning/test_vector_calibration.py, with fewer samples of a pose.
    assert np.allclose(accel.matrix @ errors.accel, np.eye(3), atol=3e-3)
    assert np.allclose(gyro.matrix @ errors.gyro, np.eye(3), atol=1.5e-2)
    assert after["attitude.mounted"] == 1
    left_g = accel.matrix @ (errors.accel_zero_g - np.mean(errors.accel_zero_g))  # one zero for three axes
    # The noise of the poses' means is not in the zeros: a quarter.
    assert found.after.norm_g == pytest.approx(np.sqrt(np.mean(left_g**2)), rel=0.25)
    # Mounted another way round: before, a pose is off by a right angle or more. 2 deg is the tenth of the least of
    # it.
    assert found.before.norm_g > found.after.norm_g and found.before.pose_deg > 20.0 > 2.0 > found.after.pose_deg
    assert found.after.turn_deg < 2.0
    assert found.remarks[0].startswith("mounted body x = sensor ")
    assert "the board has one zero for all three axes" in found.remarks[1]


def test_what_a_hand_does_wrong_is_refused_with_the_reason(bench: Bench) -> None:
    hand = bench.hand

    def clipped() -> None:
        bench.spoil = lambda samples: [(*sample[:3], 4095, *sample[4:]) for sample in samples]

    def lost() -> None:
        bench.spoil = lambda samples: samples[::2]

    def unsampled() -> None:
        bench.spoil = lambda samples: [(-32768,) * 6 if index % 9 == 0 else one for index, one in enumerate(samples)]

    _, clumsy = calibrate(
        bench,
        n2=lambda: hand.put("level"),
        n3=lambda: hand.put("upside down", share=0.25),
        n4=lambda: hand.put("upside down", over_s=6.0),
        n5=clipped,
        n6=lost,
        n7=unsampled,
        n8=lambda: hand.put("upside down"),
    )
    refusals = [text.partition(": ")[2].partition(":")[0] for text in clumsy.refusals]
    assert clumsy.refusals[0].startswith("upside down: it reads the same as in the pose 'level'")
    assert refusals[1].startswith("no side is up") and refusals[2].endswith("felt a motion"), refusals
    assert refusals[3].startswith("the accelerometer is at its limit (axis x)")
    assert refusals[4].startswith("only 50 of 100 samples came") and refusals[5].startswith(
        "only 88 of 100 samples came"
    )
    assert len(refusals) == 6


def test_a_turn_that_goes_wrong_begins_again_from_level(bench: Bench) -> None:
    """Poses are requests 1 to 6, the rest before the turns 7, and the turns 8 to 13."""
    hand = bench.hand
    found, clumsy = calibrate(
        bench,
        n8=lambda: hand.put("right side up"),
        n10=lambda: hand.put("left side up", share=-3.0, over_s=3.0),
    )
    assert len(clumsy.refusals) == 2 and clumsy.asked == 17  # 9 and 11 are the rest before the turns
    assert clumsy.refusals[0].startswith("'left side up' at the end of the turn: it is 180 degrees off")
    assert "the gyro felt 270 degrees, for 90: turn it once, the short way" in clumsy.refusals[1]
    assert found.after.turn_deg < 2.0


def test_giving_up_ends_the_run_of_the_board(bench: Bench) -> None:
    clumsy = Clumsy(bench, {number: lambda: None for number in range(2, 9)}, patience=2)
    session: Any = bench
    with pytest.raises(VerdictError, match="the same as in the pose 'level'"):
        calibration_of(session).run(clumsy)
    assert bench.ended == 1


def test_a_system_about_three_axes_is_not_calibrated_about_one(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    table = {"system": declarations.system("attitude").number}
    monkeypatch.setattr("plumb.calibration.axis_calibration.parameter_table.read_table", lambda session: [])
    monkeypatch.setattr("plumb.calibration.axis_calibration.by_name", lambda rows: table)
    session: Any = bench
    with pytest.raises(UsageError, match="attitude is calibrated about three axes"):
        Calibration(session)
