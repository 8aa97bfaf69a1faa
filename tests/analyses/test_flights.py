"""Flights: what the controller does, what the seeds draw, who crashes, and rows in the comparison."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from plumb import __main__ as front
from plumb.analyses.flights import inputs
from plumb.analyses.flights.estimators import Estimator, Flown, estimators
from plumb.analyses.flights.flights import FLIGHTS, Flight
from plumb.analyses.flights.fly import Flew, fly
from plumb.errors import UsageError
from plumb.physics import pilots
from plumb.physics.airframe import AIRFRAMES, HUMMINGBIRD, Airframe, thrust_share
from plumb.physics.cascade import Cascade
from plumb.physics.imu import MPU6050, ImuGrade
from plumb.spec.arrays import FloatArray

Counts = npt.NDArray[np.int16]


class Fixed:
    """Says the same vertical always; notes the thrust commands that it gets."""

    def __init__(self, up: Sequence[float], runs: int, thrusts: list[float]) -> None:
        self._up, self._thrusts = np.tile(up, (runs, 1)), thrusts

    def step(self, counts: Counts, thrust: FloatArray) -> FloatArray:
        assert counts.shape == (len(self._up), 6)
        self._thrusts.append(float(thrust[0]))
        return self._up

    def sigma_deg(self) -> FloatArray:
        return np.full(len(self._up), 2.0)

    def restarts(self) -> int:
        return 0


def saying(up: Sequence[float], thrusts: list[float] | None = None) -> Estimator:
    noted: list[float] = [] if thrusts is None else thrusts

    def begin(_grade: ImuGrade, _frame: Airframe, _period_us: int, runs: int) -> Flown:
        return Fixed(up, runs, noted)

    return Estimator("fixed", "test", "", "", None, begin)


def short(name: str, seconds: float) -> Flight:
    return replace(FLIGHTS[name], seconds=seconds)


def rms_deg(one: Flew) -> float:
    return float(np.sqrt(np.nanmean(one.errors_deg**2)))


@pytest.mark.parametrize("frame", AIRFRAMES.values())
def test_the_mixer_makes_the_thrust_and_the_torque_that_are_asked_for(frame: Airframe) -> None:
    cascade, up = Cascade(frame, 1, 0.0025), np.array([[0.0], [0.0], [1.0]])
    still, weight = np.zeros((3, 1)), np.array([frame.weight_n])
    command = cascade.command(up, up, np.zeros(1), still, weight, np.ones(1, np.bool_))
    made = frame.allocation() @ (thrust_share(command) * frame.thrust_max_n / 4.0)
    assert made[:, 0] == pytest.approx([frame.weight_n, 0.0, 0.0, 0.0], abs=1e-9)
    forward = pilots.vertical(np.zeros(1), np.array([0.1]))
    pushed = frame.allocation() @ thrust_share(
        cascade.command(up, forward, np.zeros(1), still, weight, np.ones(1, np.bool_))
    )
    assert pushed[2, 0] > 0.0 and abs(pushed[1, 0]) < 1e-9  # nose down: about +y, with y to the left
    right = pilots.vertical(np.array([0.1]), np.zeros(1))
    pushed = frame.allocation() @ thrust_share(
        cascade.command(up, right, np.zeros(1), still, weight, np.ones(1, np.bool_))
    )
    assert pushed[1, 0] > 0.0


def test_a_drag_setting_reaches_the_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    thrusts: list[float] = []

    def begin(_grade: ImuGrade, frame: Airframe, _period_us: int, runs: int) -> Flown:
        thrusts.append(frame.drag_setting_per_s)
        return Fixed((0.0, 0.0, 1.0), runs, [])

    noting = Estimator("noting", "test", "", "", None, begin)
    monkeypatch.setitem(FLIGHTS, "iris", short("iris", 0.1))
    inputs.flown("iris", [1000], [noting], lambda _: None)
    inputs.flown("iris", [1000], [noting], lambda _: None, 0.4)
    assert thrusts == [0.5, 0.4]


def test_commands_stay_within_their_range() -> None:
    cascade = Cascade(HUMMINGBIRD, 1, 0.0025)
    up, wanted = np.array([[0.0], [0.0], [1.0]]), np.array([[1.0], [0.0], [0.0]])
    for thrust in (0.0, 0.5, 1.0):
        all_of_it = np.array([thrust * HUMMINGBIRD.thrust_max_n])
        command = cascade.command(up, wanted, np.ones(1), np.zeros((3, 1)), all_of_it, np.ones(1, np.bool_))
        assert np.all((command >= 0.05) & (command <= 1.0))


def test_an_estimate_that_never_changes_crashes_and_is_scored_until_then() -> None:
    thrusts: list[float] = []
    (flew,) = fly(short("calm-centred", 14.0), [1000, 1001], [saying((0.3, 0.0, 0.954), thrusts)])
    assert flew.crashed.all() and flew.sigma_deg is not None and flew.sigma_deg.shape == flew.errors_deg.shape
    assert not np.isfinite(flew.errors_deg[-1]).any()
    at_rest = round(5.0 / 0.0025)
    assert set(thrusts[:at_rest]) == {0.0} and 0.3 < thrusts[at_rest + 1] < 0.6


@pytest.mark.slow
def test_a_seed_is_the_same_flight_whatever_other_seeds_fly() -> None:
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")
    flight, both = short("wind-5-place", 11.0), estimators(["VQF", "attitude"])
    first, again = fly(flight, [1000, 1001], both), fly(flight, [1000, 1001], both)
    alone = fly(flight, [1001], both[:1])
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.errors_deg, other.errors_deg, equal_nan=True)
    assert not np.array_equal(first[0].errors_deg[:, 0], first[0].errors_deg[:, 1], equal_nan=True)
    scored = np.isfinite(alone[0].errors_deg[:, 0])
    assert first[0].errors_deg[scored, 1] == pytest.approx(alone[0].errors_deg[scored, 0], abs=0.05)


@pytest.mark.slow
def test_every_estimator_flies_while_it_is_calm() -> None:
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")
    flown = {one.estimator: one for one in fly(short("calm-place", 18.0), [1000, 1001], estimators())}
    assert list(flown)[:3] == ["VQF", "BasicVQF", "Mahony"] and "attitude" in flown
    for name, limit in (("VQF", 2.5), ("BasicVQF", 8.0), ("Mahony", 4.0), ("attitude", 1.5)):
        one = flown[name]
        assert not one.crashed.any() and one.restarts == 0 and 0.05 < rms_deg(one) < limit, (name, rms_deg(one))
    assert flown["VQF"].sigma_deg is None and flown["attitude"].sigma_deg is not None


@pytest.mark.slow
def test_rivals_err_in_flight_by_what_they_take_for_the_vertical() -> None:
    """While 15 deg of pitch are held, the acceleration along the body's z axis looks like the vertical."""
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")
    flown = fly(short("pitch-15", 30.0), [1000, 1001], estimators(["VQF", "Mahony"]))
    vqf, mahony = (rms_deg(one) for one in flown)
    assert 2.5 < vqf < 6.0 and 1.5 < mahony < 6.0, (vqf, mahony)


@pytest.mark.slow
def test_a_take_off_ends_on_the_ground() -> None:
    thrusts: list[float] = []
    inner = next(one for one in estimators(["attitude"]))

    class Noting:
        def __init__(self, flown: Flown) -> None:
            self._flown = flown
            self.sigma_deg, self.restarts = flown.sigma_deg, flown.restarts

        def step(self, counts: Counts, thrust: FloatArray) -> FloatArray:
            thrusts.append(float(thrust[0]))
            return self._flown.step(counts, thrust)

    noting = replace(inner, begin=lambda *given: Noting(inner.begin(*given)))
    (flew,) = fly(short("take-off-slope", 44.0), [1000], [noting])
    assert not flew.crashed.any() and rms_deg(flew) < 3.0
    assert thrusts[-1] == 0.0 and 0.3 < thrusts[round(20.0 / 0.0025)] < 0.6 and thrusts[round(4.9 / 0.0025)] == 0.0


def test_pilots_ask_for_what_their_titles_say() -> None:
    nothing = np.zeros((3, 1))

    def seen(time_s: float, east_m: float = 0.0) -> pilots.Seen:
        place = np.array([[east_m], [0.0], [0.0]])
        sticks = np.full((100, 2, 1), 0.5)
        return pilots.Seen(time_s, place, nothing, np.array([[1.0], [0.0]]), sticks, np.zeros((2, 1)))

    assert np.degrees(pilots.held(seen(1.0))[1]) == pytest.approx([15.0])
    roll, _, yaw = pilots.orbit(seen(1.0))
    assert np.degrees([roll[0], yaw[0]]) == pytest.approx([20.0, -40.0])
    assert np.degrees([pilots.shuttle(seen(t))[1][0] for t in (1.0, 9.0, 17.0)]) == pytest.approx([25.0, -25.0, 25.0])
    assert np.degrees(pilots.sticks(seen(1.0))[0]) == pytest.approx([17.5])
    assert pilots.place(seen(1.0, east_m=2.0))[1][0] < 0.0  # too far ahead: leans back
    assert np.degrees(pilots.place(seen(1.0, east_m=99.0))[1]) == pytest.approx([-20.0])


def test_flights_are_chosen_by_name() -> None:
    assert inputs.chosen(["sticks", "calm-place"]) == ["calm-place", "sticks"]
    assert "hover-10-min" not in inputs.chosen(()) and inputs.chosen(["hover-10-min"]) == ["hover-10-min"]
    with pytest.raises(UsageError, match=r"^there is no flight 'loop'; there are calm-centred, "):
        inputs.chosen(["loop"])
    with pytest.raises(UsageError, match=r"^no algorithm 'quad' flies; there are VQF, BasicVQF, Mahony, "):
        estimators(["quad"])
    assert FLIGHTS["calm-place"].grade is MPU6050


def test_flights_are_rows_of_the_comparison(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("vqf", reason="vqf is not installed: the extra compare")
    monkeypatch.setitem(FLIGHTS, "calm-centred", short("calm-centred", 10.5))
    options = ["--flights", "--only", "calm-centred", "--seeds", "2", "--algorithm", "VQF", "--algorithm", "attitude"]
    assert front.main(["compare", *options, "--json"]) == 0
    (thrusts,) = json.loads(capsys.readouterr().out)["inputs"]
    assert thrusts["input"] == "calm-centred" and list(thrusts["means_deg"]) == ["VQF", "attitude"]
    assert [(row["seed"], row["algorithm"]) for row in thrusts["rows"]] == [
        (1000, "VQF"), (1000, "attitude"), (1001, "VQF"), (1001, "attitude"),
    ]  # fmt: skip
    assert thrusts["flown"][1] == {"algorithm": "attitude", "crashes": 0, "restarts": 0, "flights": 2}
    assert front.main(["compare", *options]) == 0
    assert "Flights that crashed / in which the estimator began again" in capsys.readouterr().out
    assert front.main(["compare", "--flights", "--motions"]) == 2
    assert "--flights stands alone" in capsys.readouterr().err
    assert front.main(["compare", "--flights", "--drag-setting", "-1"]) == 2
    assert "--drag-setting belongs to --flights" in capsys.readouterr().err
