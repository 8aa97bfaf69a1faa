"""A vehicle's signals that the link has no room for come from the integer model, while the board equals it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from plumb.cockpit.samples import Samples
from plumb.proof.shadow import Shadow
from plumb.spec import dbc
from support.cockpit_bench import CockpitBench


@pytest.fixture(params=["quadrotor", "wheels"])
def vehicle(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[CockpitBench]:
    bench = CockpitBench(tmp_path, system=request.param)
    yield bench
    bench.close()


def running(bench: CockpitBench) -> Samples:
    bench.begin()
    bench.turn(0.5)
    assert bench.loop.samples is not None
    return bench.loop.samples


def test_every_signal_of_a_vehicle_has_a_value(vehicle: CockpitBench) -> None:
    samples = running(vehicle)
    newest = samples.newest()
    assert {column.name for column in samples.columns} == set(newest)
    assert all(math.isfinite(value) for value in newest.values())


def test_an_attitude_has_roll_pitch_and_yaw_and_four_motors_four_pulses(tmp_path: Path) -> None:
    bench = CockpitBench(tmp_path, system="quadrotor")
    samples = running(bench)
    sent = set(bench.board.session.selection.frames)
    assert not sent.issuperset(dbc.frame_names("quadrotor")), "the link has room for all: nothing is tested"
    newest = samples.newest()
    assert [column.name for column in samples.columns[:3]] == ["roll_deg", "pitch_deg", "yaw_deg"]
    w, x, y, z = (newest[name] for name in "wxyz")
    assert math.hypot(w, x, y, z) == pytest.approx(1.0, abs=1e-6)
    assert newest["roll_deg"] == pytest.approx(math.degrees(math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))))
    assert [newest[f"pulse_{i}_us"] for i in range(4)] == [1000.0] * 4
    bench.close()


def test_the_page_gets_the_columns_that_drive_motors(vehicle: CockpitBench) -> None:
    running(vehicle)
    vehicle.turn(0.5)
    run = vehicle.loop.state["run"]
    assert isinstance(run, dict)
    driving = [column["name"] for column in run["columns"] if column["drives"]]
    four, two = [f"pulse_{i}_us" for i in range(4)], ["left", "right"]
    assert driving == {"quadrotor": four, "wheels": two}[run["system"]]


def test_without_a_model_the_columns_are_those_of_the_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = CockpitBench(tmp_path, system="quadrotor")
    monkeypatch.setattr("plumb.cockpit.board_run.table", lambda: [])
    names = {column.name for column in running(bench).columns}
    assert "pulse_0_us" in names and "pulse_3_us" not in names
    bench.close()


def test_a_step_that_was_not_equal_gives_no_value(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = CockpitBench(tmp_path, system="quadrotor")
    samples = running(bench)
    monkeypatch.setattr(Shadow, "follow", lambda *_: None)
    bench.turn(0.1)
    assert "pulse_3_us" not in samples.newest() and "raw_gyro_x" in samples.newest()
    bench.close()


def test_choices_and_flags_are_words_and_arming_names_who_arms(vehicle: CockpitBench) -> None:
    running(vehicle)
    vehicle.turn(0.5)
    said = json.loads(json.dumps(vehicle.loop.state))
    assert set(said["health"]["choices"]) == {"phase"} and ";" not in said["health"]["choices"]["phase"]
    assert isinstance(said["health"]["flags_set"], list)
    assert said["why_no_setpoint"].startswith(f"{vehicle.system} takes more than a slider")
