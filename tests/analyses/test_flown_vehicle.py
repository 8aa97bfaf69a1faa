"""`plumb tune vehicle`: hover and drag of a simulated vehicle, from the recording of its flight."""

from __future__ import annotations

import json
from argparse import Namespace
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from plumb import __main__ as front
from plumb.analyses.identification import vehicle_fit
from plumb.analyses.identification.vehicle_fit import VehicleFit
from plumb.api.parameters import Parameters
from plumb.boards.contract import RawCounts, Setpoints
from plumb.boards.native import core as native_core
from plumb.cli import options, tune_vehicle
from plumb.contract.parameters import ControlParams, quantise
from plumb.errors import UsageError
from plumb.judging.quadrotor import flown_vehicle, iris
from plumb.link.session import Session
from plumb.link.transports.slcan_bus import PlumbBus
from plumb.physics.airframe import AIR_KGPM3, HUMMINGBIRD_X, IRIS_X, Airframe
from plumb.physics.vectors import to_body
from plumb.spec.arrays import FloatArray
from plumb.spec.records import Words
from plumb.systems.quadrotor import scenarios
from plumb.systems.quadrotor.plant import command_of
from plumb.systems.quadrotor.tuning import QuadrotorTuning
from plumb.systems.quadrotor.vehicle import Vehicles
from support.native_board import UartBoard
from support.recordings import log_of_counts

PERIOD_US, SECONDS, RUNS, WIND_MPS = 5_000, 46.0, 10, 4.0
FRAMES = {"hummingbird": (HUMMINGBIRD_X, scenarios.HUMMINGBIRD), "iris": (IRIS_X, iris.tuning())}


@dataclass(frozen=True)
class Flights:
    """raw: (steps, runs, 12); throttle, flags, drag_per_s: (steps, runs); words of each run; air_mps: across the body,
    (steps, 2, runs)."""

    frame: Airframe
    params: ControlParams
    raw: RawCounts
    throttle: Setpoints
    words: tuple[Words, ...]
    air_mps: FloatArray
    drag_per_s: FloatArray

    def fit(self, run: int) -> VehicleFit:
        return vehicle_fit.fit(flown_vehicle.of_words(self.params, self.raw[:, run], self.words[run]))

    def true_drag_per_s(self, run: int) -> float:
        """Of all steps in the air, as a linear drag would be fitted to the true one."""
        square = (self.air_mps[..., run] ** 2).sum(axis=1) * (self.drag_per_s[:, run] > 0.0)
        return float(np.sum(self.drag_per_s[:, run] * square) / np.sum(square))


def flights(scenario: str, frame: Airframe, tuning: QuadrotorTuning, runs: int, seconds: float, wind: float) -> Flights:
    """Flights with an estimator whose drag is set to 0; the thrust of a hover, because they begin in the air."""
    aid = replace(tuning.attitude.aid, drag_per_s=0.0, hover=frame.hover_command)
    tuning = replace(tuning, period_us=PERIOD_US, attitude=replace(tuning.attitude, aid=aid))
    drawn = [scenarios.scenario(scenario, seed, seconds=seconds, period_us=PERIOD_US) for seed in range(runs)]
    drawn = [replace(one, course=replace(one.course, wind_mps=wind)) for one in drawn]
    params = quantise(drawn[0].fit(tuning))
    vehicles, core = Vehicles(drawn, frame=frame), native_core.Controllers(params, runs)
    rows, records, command = [], [], np.zeros((4, runs))
    for step in range(drawn[0].steps):
        if step:
            vehicles.advance(command)
        inputs, throttle = np.concatenate([vehicles.counts(), vehicles.commands()], 1), vehicles.throttle_q15()
        words = core.step(inputs, throttle)
        command = command_of(np.stack([words[f"pulse_halfus_{rotor}"] for rotor in range(4)]))
        body = vehicles.body
        air = to_body(body.matrix, body.velocity_mps - vehicles.wind_mps())
        rotors = frame.rotor_drag_kg * body.rotor_radps.sum(axis=0)
        whole = rotors + 0.5 * AIR_KGPM3 * frame.drag_area_m2 * np.linalg.norm(air, axis=0) * (rotors > 0.0)
        rows.append((inputs, throttle, air[:2], whole / frame.mass_kg))
        records.append(words.record.copy())
    raw, throttles, air_mps, drag = (np.stack(column) for column in zip(*rows, strict=True))
    every = np.stack(records)
    of_runs = tuple(Words(np.ascontiguousarray(every[:, run])) for run in range(runs))
    return Flights(frame, params, raw, throttles, of_runs, air_mps, drag)


@pytest.fixture(scope="module", params=FRAMES)
def flown(request: pytest.FixtureRequest) -> Flights:
    """Both sticks, a new lean every 0.7 s, in a wind with gusts."""
    return flights("sticks", *FRAMES[request.param], RUNS, SECONDS, WIND_MPS)


@pytest.mark.slow
def test_the_truth_is_within_the_stated_interval_and_the_interval_is_narrow(flown: Flights) -> None:
    fits = [flown.fit(run) for run in range(RUNS)]
    assert sum(fit.drag_per_s.holds(flown.true_drag_per_s(run)) for run, fit in enumerate(fits)) >= 0.9 * RUNS
    assert sum(fit.hover.holds(flown.frame.hover_command) for fit in fits) >= 0.9 * RUNS
    assert all(fit.drag_per_s.half < 0.3 * fit.drag_per_s.value for fit in fits)
    assert all(fit.hover.half < 0.05 * fit.hover.value for fit in fits)


@pytest.mark.slow
def test_the_drag_is_that_of_rotors_and_frame(flown: Flights) -> None:
    """More than that of the rotors alone, and near the setting of this frame's estimator."""
    found = np.mean([flown.fit(run).drag_per_s.value for run in range(RUNS)])
    assert flown.frame.drag_per_s < found
    assert found == pytest.approx(flown.frame.drag_setting_per_s, rel=0.25)


def test_a_flight_that_hovers_or_is_short_is_refused() -> None:
    still = flights("calm", HUMMINGBIRD_X, scenarios.HUMMINGBIRD, 1, SECONDS, 0.0)
    with pytest.raises(UsageError, match=r"the flight does not determine the drag: its speed changed by 0\.\d m/s rms"):
        still.fit(0)
    short = replace(still, raw=still.raw[:4000], words=(Words(still.words[0].record[:4000]),))
    with pytest.raises(UsageError, match=r"2 windows of 6 s in the air are too few, 6 are needed: fly to and fro"):
        short.fit(0)


@pytest.mark.slow
def test_the_command_takes_a_log_and_gives_the_lines_that_set_it(
    flown: Flights, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = log_of_counts(tmp_path / "flight.plog", flown.params, flown.raw[:, 0], setpoint=flown.throttle[:, 0])
    assert front.main(["tune", "vehicle", str(log), "--json"]) == 0
    report, fit = json.loads(capsys.readouterr().out), flown.fit(0)
    assert report["settings"] == {
        "attitude.aid.drag_per_s": fit.drag_per_s.value,
        "attitude.aid.hover": fit.hover.value,
    }
    assert report["drag_per_s"]["low"] < report["drag_per_s"]["value"] < report["drag_per_s"]["high"]
    assert front.main(["tune", "vehicle", str(log), "--write"]) == 2
    assert "--write and --board B go together" in capsys.readouterr().err
    assert report["apply"][0].startswith("plumb params set attitude.aid.drag_per_s=")


def test_what_was_found_is_set_on_a_board_and_saved(monkeypatch: pytest.MonkeyPatch) -> None:
    session = Session(PlumbBus(UartBoard()))
    session.connect()
    session.upload(quantise(scenarios.HUMMINGBIRD).words(), period_us=scenarios.PERIOD_US)
    monkeypatch.setattr(options, "linked_board_of", lambda arguments: nullcontext(SimpleNamespace(session=session)))
    tune_vehicle.write(Namespace(), {"attitude.aid.drag_per_s": 0.4, "attitude.aid.hover": 0.66})
    parameters = Parameters(session)
    assert parameters["attitude.aid.drag_per_s"] == pytest.approx(0.4, rel=1e-3)
    assert parameters["attitude.aid.hover"] == pytest.approx(0.66, rel=1e-3)
    session.execute_idle("LOAD")
    assert Parameters(session)["attitude.aid.hover"] == pytest.approx(0.66, rel=1e-3), "as it was saved"
