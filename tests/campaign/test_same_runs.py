"""A run of a campaign gives the digests, the inputs and the figures of `plumb run` with its seed."""

from __future__ import annotations

import math
import zlib

import numpy as np
import pytest

from plumb import systems
from plumb.boards.native import plant as native_plant
from plumb.campaign import batch
from plumb.campaign.study import Study, from_table
from plumb.proof import runs, scenario_run
from plumb.systems.compiled_plants import COMPILED
from support.declared_systems import lacking


def scenarios(name: str, open_loop: bool) -> list[str]:
    """All where a plant in C has to follow each; else the first and the last, which take one way."""
    every = list(systems.load(name).SCENARIOS)
    compiled = name in systems.with_part(COMPILED.name)
    in_c = compiled and not (open_loop and not systems.load(name, COMPILED).PRESCRIBES)
    return every if in_c else [every[0], every[-1]]


CASES = [
    {"system": name, "scenario": scenario, "open_loop": open_loop, "seconds": 12}
    for name in systems.SYSTEMS
    for open_loop in ((False, True) if systems.load(name).OUTPUTS else (True,))
    for scenario in scenarios(name, open_loop)
]
FAULTS = [
    {"system": "quadrotor", "scenario": "gust", "faults": ["flickering:accel_x@8-10", "stuck:gyro_z@9.5-10"]},
    {"system": "quadrotor", "scenario": "weak", "faults": ["missing:gyro_x@9.2-9.3", "amplified:gyro_y@10"]},
    {"system": "quadrotor", "scenario": "kick", "faults": ["stuck:accel_x@8", "noisy:gyro_x@9-10"], "open_loop": True},
    {"system": "quadrotor", "scenario": "gust", "vary": {"tuning.period_us": [1000]}},
    {"system": "wheels", "scenario": "turns", "faults": ["stuck:left@8-9", "noisy:right@9", "stuck:accel_x@10"]},
    {"system": "wheels", "scenario": "receiver", "faults": ["silent:gyro_up@7", "railed:accel_z@8-8.1"]},
    {"system": "quad", "scenario": "hold", "faults": ["stuck:gyro@4-6", "push:0.2@7-7.2", "push:0.1@7.1-8"]},
    {"system": "quad", "faults": ["noisy:accel_y@4", "railed:gyro@9-10"], "conditions": {"delay_ms": 7.0}},
    {"system": "quad", "faults": ["silent:accel_z@4"], "conditions": {"bandwidth_hz": 20.0}, "open_loop": True},
    {"system": "balancer", "faults": ["stuck:hall@6-8", "noisy:gyro@4", "push:6@9-9.2"]},
    {"system": "balancer", "faults": ["railed:accel_x@4-5", "silent:accel_z@6", "stuck:gyro@5"]},
    {"system": "balancer", "faults": ["push:6@5-5.2", "stuck:accel_x@4-5"], "open_loop": True},
]


def compare(study: Study, index: int) -> None:
    request = study.request(index)
    alone = scenario_run.perform(request)
    found = batch.run_one(request)
    assert np.array_equal(found.words.digests(), alone.run.answer.digests)
    assert batch.digest_of(found.words) == batch.digest_of(alone.run.words)
    assert np.array_equal(found.inputs.setpoint, alone.run.inputs.setpoint)
    for name, truth in alone.run.inputs.truth.items():
        assert np.array_equal(found.inputs.truth[name], truth, equal_nan=True), name


@pytest.mark.parametrize("table", CASES, ids=lambda table: "-".join(str(one) for one in table.values()))
def test_digests_are_those_of_plumb_run(table: dict[str, object]) -> None:
    """Long enough for a vehicle that rests at first to fly."""
    compare(from_table({**table, "seconds": 6, "runs": 40}), 7)


@pytest.mark.parametrize("table", FAULTS, ids=lambda table: " ".join(map(str, table.values())))
def test_faults_and_conditions_are_those_of_plumb_run(table: dict[str, object]) -> None:
    compare(from_table({**table, "seconds": 12, "runs": 40}), 3)


@pytest.mark.parametrize("system", systems.with_part(COMPILED.name))
def test_a_plant_in_c_is_in_the_core_and_is_used(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def in_python(*_arguments: object) -> None:
        raise AssertionError("the loop was closed in Python")

    assert native_plant.available(system)
    monkeypatch.setattr(runs, "closed_loop_inputs", in_python)
    assert len(batch.run_one(from_table({"system": system, "seconds": 2}).request(0)).words.record)


@pytest.mark.parametrize("system", [*systems.with_part("plant"), *lacking("plant")[:1]])
def test_figures_are_those_of_plumb_run(system: str) -> None:
    study = from_table({"system": system, "seconds": 4, "runs": 3, "reference": True})
    found = batch.run_batch(study, range(3))
    alone = scenario_run.perform(study.request(2)).run.metrics()
    del alone["target_vs_fixed_mismatches"]
    given = {name: column[2] for name, column in found.metrics.items()}
    for name, value in alone.items():
        assert value is None or math.isclose(given[name] or 0.0, value, rel_tol=1e-9, abs_tol=1e-12), name


def test_the_digest_of_a_run_is_that_of_its_records_in_order() -> None:
    words = batch.run_one(from_table({"system": "quad", "seconds": 2}).request(0)).words
    assert batch.digest_of(words) == zlib.crc32(b"".join(one.tobytes() for one in words.record))
