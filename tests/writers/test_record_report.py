"""The page of a recording: angles and sticks first, in the units of people; integers folded behind them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from plumb import systems
from plumb.contract.parameters import quantise
from plumb.proof.report import page
from plumb.readers import log_replay
from plumb.readers.step_quantities import quantities_of
from plumb.readers.table_column import Column
from plumb.spec import declarations
from plumb.spec.quaternion_angles import ANGLES
from plumb.writers.record_report import no_height, page_of, panels
from support.recordings import log_of_counts

ONES = np.ones(5)
ROLLED = {"w": np.cos(0.1 * ONES), "x": np.sin(0.1 * ONES), "y": 0.0 * ONES, "z": 0.0 * ONES}
"""An attitude rolled by 0.2 rad."""


FLYING = systems.with_part("fly")[0]


def flown() -> list[Column]:
    integers = np.full(5, 16384, np.int64)
    found = [
        Column("time_s", "s", np.arange(5.0)),
        Column("step", "", np.arange(5)),
        Column("setpoint", "", integers),
        Column("raw_gyro_x_counts", "counts", integers),
        Column("gyr_x_dps", "deg/s", ONES),
        Column("command_roll", "", -integers),
        Column("command_switches", "", integers),
        Column("pulse_0_us", "us", 1500.0 * ONES, None, "ROTOR_0"),
        *(Column(name, "", values, None, "ROTOR_0") for name, values in ROLLED.items()),
        Column("phase", "", 0 * integers, None, "STATE"),
        Column("flags", "", integers, None, "STATE"),
    ]
    module = systems.load(FLYING)
    params = quantise(module.TUNINGS[module.DEFAULT_TUNING])
    return [found[0], *quantities_of(found, declarations.system(FLYING), params), *found[1:]]


def test_angles_and_sticks_stand_first_and_integers_are_folded() -> None:
    found = panels(flown(), declarations.system(FLYING))
    titles = [plot.title for plot in found]
    assert titles[:4] == ["Signals in deg", "Sticks", "Motors", "Signals in us"] and "Sensors in deg/s" in titles
    angles, sticks, *_ = found
    assert [line.label for line in angles.lines] == [f"{name}_deg" for name in ANGLES]
    assert np.allclose(angles.lines[0].values, np.degrees(0.2)) and np.allclose(angles.lines[1].values, 0.0)
    assert {line.label: float(line.values[0]) for line in sticks.lines} == {"throttle": 50.0, "roll": -50.0}
    assert {plot.title for plot in found if plot.folded} == {"Raw counts", "command_switches", "flags"}
    assert all(plot.folded for plot in found[-3:])
    phase = next(plot for plot in found if plot.title == "phase")
    assert phase.note.startswith("0: ") and not phase.folded


def test_a_folded_panel_is_in_the_page_and_closed() -> None:
    html = page("t", "", "", panels(flown(), declarations.system(FLYING)))
    assert html.count("<details><summary>") == 3 and "<details><summary>Raw counts</summary>" in html


def test_a_system_without_attitude_keeps_its_angles_and_groups_its_shares() -> None:
    columns = [
        Column("time_s", "s", np.arange(5.0)),
        Column("left", "", ONES, None, "DRIVE"),
        Column("right", "", ONES, None, "TURN"),
        Column("tilt_deg", "deg", ONES, None, "ANGLE"),
    ]
    found = panels(columns, declarations.system(systems.with_part("ride")[0]))
    assert [(plot.title, len(plot.lines)) for plot in found] == [("Signals in deg", 1), ("Shares", 2)]


def test_a_flight_says_once_why_it_has_no_height(tmp_path: Path) -> None:
    module, declared = systems.load(FLYING), declarations.system(FLYING)
    params = quantise(module.TUNINGS[module.DEFAULT_TUNING])
    log = log_of_counts(tmp_path / "run.plog", params, np.zeros((20, declared.inputs), np.int16))
    (recorded,) = log_replay.runs_of(log_replay.open_log(log))
    assert page_of(recorded).count("There is no height: ") == 1
    assert no_height([*flown(), Column("height_m", "m", ONES)], declared) == ""
    assert no_height([], declarations.system(systems.with_part("ride")[0])) == ""
