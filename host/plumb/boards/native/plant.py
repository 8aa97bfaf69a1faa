"""Whole closed loops in C: the core and the plant of a system (plant.c), one call a run."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from plumb import systems
from plumb.boards.contract import RawCounts, Setpoints
from plumb.boards.native import build as native_build
from plumb.boards.native import core as native_core
from plumb.contract.parameters import ControlParams
from plumb.contract.scenario import Scenario
from plumb.errors import UsageError
from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.spec.records import RECORDS, Words
from plumb.systems.compiled_plants import COMPILED, DrawnRun

FAULTS_MOST = 32
"""PLANT_FAULTS_MAX."""


class _Plant(ctypes.Structure):
    """plant_t of firmware/ports/batch/plant.h."""

    _fields_ = (
        ("numbers", ctypes.c_char_p),
        ("signals", ctypes.c_char_p),
        ("truth", ctypes.c_char_p),
        ("bytes", ctypes.c_size_t),
        ("truths", ctypes.c_int32),
        ("begin", ctypes.c_void_p),
        ("follow", ctypes.c_void_p),
        ("sample", ctypes.c_void_p),
        ("setpoint", ctypes.c_void_p),
    )


class _Run(ctypes.Structure):
    """plant_run_t."""

    _fields_ = (
        ("numbers", ctypes.c_void_p),
        ("signals", ctypes.c_void_p),
        ("faults", ctypes.c_void_p),
        ("fault_count", ctypes.c_int32),
        ("steps", ctypes.c_int32),
        ("points", ctypes.c_int32),
    )


@dataclass(frozen=True)
class Answer:
    """Result of a closed loop: raw counts (steps, inputs), setpoints, the words of every step, and the true state by
    name, each of shape (steps,)."""

    raw: RawCounts
    setpoint: Setpoints
    words: Words
    truth: dict[str, FloatArray]


def available(system: str) -> bool:
    """Whether the loaded core has the plant of a system."""
    return hasattr(native_core.c_core(), f"plumb_plant_{system}") and _is_file(
        COMPILED.path(declarations.system(system))
    )


_is_file = cache(Path.is_file)
"""Cached, because a campaign asks for every run; the files of a system do not change meanwhile."""


def closed_loop(scenario: Scenario, params: ControlParams, *, open_loop: bool = False) -> Answer:
    """Run a scenario with the core and the plant in C. open_loop: the outputs move nothing. Raises UsageError for a
    plant or a core of another version."""
    system, core = params.system, native_core.c_core()
    native_core.require_valid(params)
    plant = _Plant.in_dll(core, f"plumb_plant_{system}")
    drawn = systems.load(system, COMPILED).drawn(scenario, open_loop=open_loop)
    _check(plant, drawn)
    declared, record = declarations.system(system), RECORDS[system]
    numbers = np.array(list(drawn.numbers.values()), np.float64)
    signals = [np.ascontiguousarray(signal, np.float64) for signal in drawn.signals.values()]
    faults = drawn.fault_rows()
    pointers = (ctypes.c_void_p * len(signals))(*(signal.ctypes.data for signal in signals))
    run = _Run(
        numbers.ctypes.data, ctypes.addressof(pointers), faults.ctypes.data, len(faults), scenario.steps, drawn.points
    )
    state = np.zeros(plant.bytes // 8 + 1, np.int64)
    places = np.array([_place(record, name) for name in systems.load(system).OUTPUTS], np.int32)
    given = np.zeros(scenario.steps, np.int32) if plant.setpoint else scenario.setpoint()
    setpoint = np.array(given, np.int32)
    raw = np.tile(np.array(declared.whole_inputs(()), np.int16), (scenario.steps, 1))
    words, truth = np.zeros(scenario.steps, record), np.zeros((scenario.steps, plant.truths))
    table = np.array([word & 0xFFFFFFFF for word in params.words()], np.uint32)
    done = core.plumb_closed_loop(
        ctypes.byref(plant), ctypes.byref(run), _pointer(state), _pointer(table), _pointer(places), len(places),
        scenario.period_us, _pointer(setpoint), _pointer(raw), _pointer(words), _pointer(truth),
    )  # fmt: skip
    if not done:
        raise UsageError(f"a run of {system} has at most {FAULTS_MOST} faults here, not {len(faults)}")
    names = (plant.truth or b"").decode().split(",")
    return Answer(raw, setpoint, Words(words), dict(zip(names, np.ascontiguousarray(truth.T), strict=True)))


def _pointer(array: npt.NDArray[np.generic]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _place(record: np.dtype[np.void], name: str) -> int:
    """Place of a word of the record, in words of 32 bits."""
    assert record.fields is not None
    return int(record.fields[name][1]) // 4


def _check(plant: _Plant, drawn: DrawnRun) -> None:
    for named, given in ((plant.numbers, drawn.numbers), (plant.signals, drawn.signals)):
        if (named or b"").decode() != ",".join(given):
            other = f"the native core is of another version than this package: run '{native_build.BUILD}'"
            raise UsageError(native_build.stale_text(native_core.core_path()) or other)
