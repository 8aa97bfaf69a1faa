"""The table of a vehicle's log says what people look for, also where the link carried raw counts alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from plumb import systems
from plumb.contract import run_fixed
from plumb.contract.parameters import ControlParams, quantise
from plumb.readers import log_replay
from plumb.readers.log_file import Frames
from plumb.readers.step_table import table_of, tables_of
from plumb.readers.table_column import Column
from plumb.spec.protocol import protocol
from plumb.spec.records import Words
from support.recordings import log_of_counts, other_digest, with_frames
from support.wild_quadrotor import wild_inputs

VEHICLE = "quadrotor"
Counts = npt.NDArray[np.int16]


def params_of(system: str) -> ControlParams:
    module = systems.load(system)
    return quantise(module.TUNINGS[module.DEFAULT_TUNING])


@pytest.fixture(scope="module")
def flown() -> tuple[Words, Counts]:
    """A flight of any kind, and what went into its steps."""
    inputs, throttle = wild_inputs(np.random.default_rng(7))
    raw, asked = inputs[:, :, 0].astype(np.int16), throttle[:, 0].astype(np.int32)
    return run_fixed.run_control(params_of(VEHICLE), raw, asked), raw


def log_of(path: Path, flown: tuple[Words, Counts], lost: tuple[int, ...] = ()) -> Path:
    """A log that has STEP and RAW frames alone."""
    words, raw = flown
    return log_of_counts(path, params_of(VEHICLE), raw, lost, words["setpoint_throttle_q15"].astype(np.int32))


def columns_of(path: Path) -> dict[str, Column]:
    (recorded,) = log_replay.runs_of(log_replay.open_log(path))
    return {column.name: column for column in table_of(recorded)}


def known(column: Column) -> int:
    return len(column.values) if column.known is None else int(np.count_nonzero(column.known))


def test_angles_rates_motors_sticks_and_phase_are_calculated(flown: tuple[Words, Counts], tmp_path: Path) -> None:
    found, (words, counts) = columns_of(log_of(tmp_path / "run.plog", flown)), flown
    w, x, y, z = (words[f"attitude_{part}_q30"] / 2.0**30 for part in "wxyz")
    roll = np.degrees(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
    assert found["roll_deg"].values == pytest.approx(roll) and np.ptp(roll) > 3.0
    up = np.stack([words[f"up_q30_{axis}"] / 2.0**30 for axis in range(3)])
    rates = np.stack([words[f"rate_turnps_q28_{axis}"] * 360.0 / 2.0**28 for axis in range(3)])
    assert found["heading_rate_dps"].values == pytest.approx((up * rates).sum(0), abs=0.1)
    for rotor in range(4):
        command = words[f"rotor_q24_{rotor}"] * 100.0 / 2.0**24
        assert found[f"motor_{rotor}_pct"].values == pytest.approx(command, abs=0.1) and command.max() > 50.0
    assert found["stick_roll_pct"].values == pytest.approx(counts[:, 6] / 327.68)
    assert found["stick_throttle_pct"].values == pytest.approx(words["setpoint_throttle_q15"] / 327.68)
    phase = found["phase_text"]
    assert np.array_equal(phase.values, words["phase"]) and phase.texts[0] == "flown"
    assert all(known(column) == len(counts) for name, column in found.items() if not name.startswith(("gyr", "acc")))


def test_nothing_is_calculated_from_lost_counts_on(flown: tuple[Words, Counts], tmp_path: Path) -> None:
    found = columns_of(log_of(tmp_path / "run.plog", flown, lost=(100,)))
    assert known(found["roll_deg"]) == known(found["motor_0_pct"]) == known(found["phase_text"]) == 100


def test_nothing_is_calculated_from_another_digest_on(flown: tuple[Words, Counts], tmp_path: Path) -> None:
    whole = log_of(tmp_path / "whole.plog", flown)
    found = columns_of(with_frames(whole, tmp_path / "run.plog", other_digest(70)))
    assert known(found["roll_deg"]) == 70


def test_the_parts_of_a_table_are_the_whole_one(
    flown: tuple[Words, Counts], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = log_of(tmp_path / "run.plog", flown)
    whole = columns_of(path)
    monkeypatch.setattr("plumb.readers.run_parts.PART_STEPS", 77)
    (recorded,) = log_replay.runs_of(log_replay.open_log(path))
    parts = list(tables_of(recorded))
    assert len(parts) > 3
    for place, name in enumerate(whole):
        assert np.array_equal(np.concatenate([part[place].values for part in parts]), whole[name].values), name


def test_the_voltage_is_that_of_the_newest_frame_until_that_is_a_second_old(
    flown: tuple[Words, Counts], tmp_path: Path
) -> None:
    message, step = protocol()["BATTERY"], protocol()["STEP"].identifier

    def with_two(frames: Frames) -> Frames:
        """11.1 V before step 10, 10.9 V before step 20."""
        for place, millivolts in ((20, 10_900), (10, 11_100)):
            at = np.flatnonzero(frames["can_id"] == step)[place]
            said = frames[at : at + 1].copy()
            said["can_id"] = message.identifier
            said["data"][0] = np.frombuffer(message.pack(place & 15, 0, millivolts, 0, millivolts), np.uint8)
            frames = np.insert(frames, at, said)
        return frames

    whole = log_of(tmp_path / "whole.plog", flown)
    battery = columns_of(with_frames(whole, tmp_path / "run.plog", with_two))["battery_v"]
    assert battery.known is not None and "battery_v" not in columns_of(whole)
    second = round(1.0 / params_of(VEHICLE).period_s)
    assert np.array_equal(np.flatnonzero(battery.known), np.arange(10, min(20 + second, len(battery.values))))
    assert set(battery.values[10:20]) == {11.1} and set(battery.values[20:second]) == {10.9}
