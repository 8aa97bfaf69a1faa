"""`plumb export --format bbl-csv`: the columns of blackbox_decode hold the words of the recorded steps, scaled."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.readers import run_parts
from plumb.spec.records import Words
from plumb.systems.blackbox import COLUMNS
from support.recordings import log_of_counts, other_digest, with_frames
from support.wild_quadrotor import wild_inputs

VEHICLE = "quadrotor"
WANTED_BY_VIEWERS = {
    "loopIteration", "time (us)", *(f"{name}[{axis}]" for name in ("axisP", "axisI", "axisD", "gyroADC", "accSmooth")
    for axis in range(3)), *(f"{name}[{at}]" for name in ("rcCommand", "setpoint", "motor") for at in range(4)),
}  # fmt: skip
"""What the usual viewers look for by name."""


def params_of(system: str) -> ControlParams:
    tunings = systems.load(system).TUNINGS
    return quantise(tunings[systems.load(system).DEFAULT_TUNING])


@pytest.fixture(scope="module")
def flown() -> Words:
    """Rest, take-off, then anything, a fifth of it without samples."""
    inputs, throttle = wild_inputs(np.random.default_rng(7))
    raw, asked = inputs[:, :, 0].astype(np.int16), throttle[:, 0].astype(np.int32)
    return run_fixed.run_control(params_of(VEHICLE), raw, asked)


@pytest.fixture(scope="module")
def log(flown: Words, tmp_path_factory: pytest.TempPathFactory) -> Path:
    names = flown.names
    raw = np.stack([flown[name] for name in names[:12]], 1).astype(np.int16)
    path = tmp_path_factory.mktemp("log") / "flight.plog"
    return log_of_counts(path, params_of(VEHICLE), raw, setpoint=flown[names[12]].astype(np.int32))


def export(log: Path, *arguments: object) -> int:
    return front.main(["export", str(log), *map(str, arguments), "--format", "bbl-csv"])


def test_every_value_is_a_word_of_the_step_scaled(
    log: Path, flown: Words, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_parts, "PART_STEPS", 97)  # terms of one part need the last step of the part before
    assert export(log, tmp_path / "flight.csv") == 0
    with (tmp_path / "flight.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    header = list(rows[0])
    assert set(header) >= WANTED_BY_VIEWERS and header == [name for name in COLUMNS if name in header]
    params = params_of(VEHICLE)

    def same(column: str, values: object) -> None:
        read = np.array([float(row[column]) for row in rows])
        assert np.abs(read - np.asarray(values, np.float64)).max() <= 0.5e-3 + 1e-9, column

    same("loopIteration", np.arange(len(flown["step"])))
    same("time (us)", np.arange(len(rows)) * 2500)
    for axis, name in enumerate(("roll", "pitch", "yaw")):
        same(f"gyroADC[{axis}]", flown[f"rate_turnps_q28_{axis}"] / 2**28 * 360)
        same(f"setpoint[{axis}]", flown[f"asked_turnps_q28_{axis}"] / 2**28 * 360)
        same(f"rcCommand[{axis}]", flown[name] / 2**15 * 500)
        terms = sum(np.array([float(row[f"axis{term}[{axis}]"]) for row in rows]) for term in "PIDF")
        asked = flown[f"{name}_demand_q24"] / 2**24 * 1000
        assert np.abs(terms - asked).max() < 2.5e-3, name
        same(f"axisI[{axis}]", flown[f"{name}_integral_q30"] / 2**30 * 1000)
    same("rcCommand[3]", 1000 + np.clip(flown["setpoint_throttle_q15"], 0, None) / 2**15 * 1000)
    for at, rotor in enumerate((3, 0, 2, 1)):  # rear right, front right, rear left, front left
        same(f"motor[{at}]", flown[f"pulse_halfus_{rotor}"] / 2)
    for at in range(3):
        rate = _held(flown[f"raw_{at}"], params["gyro.offset"], params["gyro.gain"]) / 2**28 * 360
        same(f"gyroUnfilt[{at}]", rate)
        same(
            f"accSmooth[{at}]",
            _held(flown[f"raw_{at + 3}"], params["accel.offset"], params["accel.gain"]) / 2**26 * 2048,
        )
    failsafe = [row["failsafePhase (flags)"] for row in rows]
    phases = np.array(["IDLE", "RX_LOSS_DETECTED", "LANDING"])
    known = flown["phase"] < 3
    assert (np.array(failsafe)[known] == phases[flown["phase"][known]]).all()
    modes = {row["flightModeFlags (flags)"] for row in rows}
    assert {"ARM", "ARM|ANGLE_MODE"} <= modes <= {"ARM", "ARM|ANGLE_MODE", "ANGLE_MODE", "0"}


def _held(counts: npt.NDArray[np.int64], offset: int, gain: int) -> npt.NDArray[np.float64]:
    """The calibrated counts, the last one where there was none."""
    found, last = [], 0.0
    for count in counts.tolist():
        last = last if count == -32768 else float(count * gain + offset)
        found.append(last)
    return np.array(found)


def test_a_system_without_pilot_and_motors_has_its_rates_and_sensors(tmp_path: Path) -> None:
    raw = np.tile(np.array([100, -200, 300, 0, 0, 2048], np.int16), (40, 1))
    made = log_of_counts(tmp_path / "body.plog", params_of("attitude"), raw)
    assert export(made, tmp_path / "body.csv") == 0
    with (tmp_path / "body.csv").open(encoding="utf-8") as file:
        row = list(csv.DictReader(file))[-1]
    assert {name.partition("[")[0] for name in row} == {
        "loopIteration", "time (us)", "gyroADC", "gyroUnfilt", "accSmooth"
    }  # fmt: skip
    assert float(row["gyroUnfilt[1]"]) < 0.0 < float(row["gyroUnfilt[2]"]) and float(row["accSmooth[2]"]) > 1900


def test_what_cannot_be_written_so_is_one_sentence(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(log: Path, name: str, sentence: str) -> None:
        assert export(log, tmp_path / name) == 2
        said = capsys.readouterr().err
        assert sentence in said and said.count("\n") == 1, said
        assert not (tmp_path / name).exists()

    refused(log, "run.html", "--format bbl-csv writes .csv files only")
    raw = np.full((30, 3), 2048, np.int16)
    one_axis = log_of_counts(tmp_path / "one.plog", params_of("quad"), raw)
    refused(one_axis, "one.csv", "quad: a blackbox viewer has no columns for what it does")
    body = np.tile(np.array([0, 0, 0, 0, 0, 2048], np.int16), (40, 1))
    gap = log_of_counts(tmp_path / "gap.plog", params_of("attitude"), body, lost=[20])
    refused(gap, "gap.csv", "a blackbox CSV needs every step of the run from its beginning: the raw counts of step 20")
    whole = log_of_counts(tmp_path / "whole.plog", params_of("attitude"), body)
    bad = with_frames(whole, tmp_path / "bad.plog", other_digest(25))
    refused(bad, "bad.csv", "step 25 of the recording is not what the integer model makes of its counts")
