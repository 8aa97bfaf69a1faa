"""No false alarm: motions of the attitude's scenarios, of the comparison, of vehicles, and of real sensors."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from plumb.analyses.comparison import motions
from plumb.audit.audit import audit, audit_of
from plumb.audit.samples import Samples
from plumb.readers import recording_files
from plumb.systems.attitude import scenarios
from support import good_recordings
from support.campaigns import campaign

SCENARIOS = ("hand", "static", "fast", "centrifuge", "fall")
MOTIONS = ("arm-200", "dash-12", "roundabout-15", "bank-turn", "merry-go-round", "vibration-100", "bias-step-rest")
FOUND = (12, 36, 42)
"""Whose alarms were false once: a vibration, a steady turn of a coarse gyro, a steady bend."""
DRAWN = sorted({*FOUND, *np.random.default_rng(4).permutation(good_recordings.NUMBERS)[: campaign(6, 100)].tolist()})


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_of_the_attitude_raises_no_alarm(name: str) -> None:
    seed = int(np.random.default_rng([*name.encode()]).integers(1 << 30))
    run = scenarios.scenario(name, seed, seconds=30.0)
    steps = run.sensed_g.shape[1]
    samples = Samples(
        np.asarray(np.arange(steps) * run.period_us * 1e-6, np.float64), run.sensed_dps.T.copy(), run.sensed_g.T.copy()
    )
    assert [one for one in audit(samples).faults if one.kind != "accelerometer-sign"] == []


@pytest.mark.parametrize("name", MOTIONS)
def test_a_vehicle_that_accelerates_raises_no_alarm(name: str) -> None:
    seed = int(np.random.default_rng([*name.encode()]).integers(1 << 30))
    moved = motions.worsened(motions.prescribed(name, seed), np.random.default_rng([seed, 1]))
    assert audit(Samples(moved.time_s, moved.gyr_dps, moved.acc_g)).faults == []


@pytest.mark.parametrize("number", DRAWN)
def test_a_drawn_recording_raises_no_alarm(number: int) -> None:
    """Motions, mounts, chips, rates, lengths, stamps. Of an instrument that lies upside down the sign cannot be told,
    and both readings are named."""
    about, samples = good_recordings.drawn(number)
    upside_down = float(np.mean(samples.acc_g[:50, 2])) < -0.8
    faults = [one.line for one in audit(samples).faults if not (upside_down and one.kind == "accelerometer-sign")]
    assert faults == [], about


@pytest.mark.parametrize("number", range(7))
def test_real_sensors_raise_no_alarm(number: int) -> None:
    folder = os.environ.get("PLUMB_DATA")
    if not folder:
        pytest.skip("set PLUMB_DATA to the folder of recordings to run this on real sensors")
    path = sorted(Path(folder).glob("*.npz"))[number]
    assert audit_of(path.name, recording_files.read(path)).faults == []
