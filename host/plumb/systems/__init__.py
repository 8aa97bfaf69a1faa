"""The systems: a published design each, with its plant, its sensors, its scenarios and its tunings.

A system's module offers

    SCENARIOS             name -> one sentence
    TUNINGS               name -> plumb.tuning.Tuning; "adaptive" is the one a run uses unless told otherwise
    scenario(name, seed)  everything random of one run, drawn; prescribed motion as counts, truth and setpoint
    plant(scenario)       the sensor board in motion: volts out, actuator pulses in
"""

from __future__ import annotations

import importlib
from types import ModuleType

from plumb.errors import UsageError

SYSTEMS = {"quad": "one axis of a quadrotor: ENC-03, MMA7260, two motors behind an ESC (Feng et al. 2011)"}


def load(name: str) -> ModuleType:
    """The module of a system; raises UsageError for a name that is none."""
    if name not in SYSTEMS:
        raise UsageError(f"there is no system '{name}'; this version has {', '.join(SYSTEMS)}")
    return importlib.import_module(f"plumb.systems.{name}")
