"""`quadrotor` in the columns of blackbox_decode: rates, what each loop asks for, sticks, motors and failsafe."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from plumb.contract.parameters import ControlParams
from plumb.spec.records import Words
from plumb.systems.blackbox import PID_UNITS, STICK_UNITS, THROTTLE_LOW, THROTTLE_UNITS, Cells
from plumb.systems.quadrotor.fixed import FLIES, LEVELS, LOST
from plumb.systems.quadrotor.fixed_phase import HELD, LANDING, RECEIVER_LOST, STOPPED

AXES = ("roll", "pitch", "yaw")
DEG_PER_Q28 = 360.0 / 2**28
HALFUS = 0.5
MOTORS = (3, 0, 2, 1)
"""Rotors in the order of such logs: rear right, front right, rear left, front left."""


def columns(words: Words, before: Words, params: ControlParams, /) -> Mapping[str, Cells]:
    found: dict[str, Cells] = {}
    for axis, name in enumerate(AXES):
        rate, asked = words[f"rate_turnps_q28_{axis}"], words[f"asked_turnps_q28_{axis}"]
        error = (asked >> 1) - (rate >> 1)
        change = ((rate >> 1) - before[f"{name}_rate_filtered_turnps_q27"]).astype(np.int32).astype(np.int64)
        terms = {
            "P": error * params[f"rate_{name}.kp_q29"] >> 32,
            "I": words[f"{name}_integral_q30"] >> 6,
            "D": -2 * (change * params[f"rate_{name}.kd_q28"] >> 32),
            "F": (asked >> 1) * params[f"rate_{name}.ff_q29"] >> 32,
        }
        found |= {f"axis{term}[{axis}]": values * (PID_UNITS / 2**24) for term, values in terms.items()}
        found[f"gyroADC[{axis}]"] = rate * DEG_PER_Q28
        found[f"setpoint[{axis}]"] = asked * DEG_PER_Q28
        found[f"rcCommand[{axis}]"] = words[name] * (STICK_UNITS / 2**15)
    stick = np.clip(words["setpoint_throttle_q15"], 0, None) * (THROTTLE_UNITS / 2**15)
    found["rcCommand[3]"] = stick + THROTTLE_LOW
    found["setpoint[3]"] = words["throttle_q15"] * (THROTTLE_UNITS / 2**15)
    found |= {f"motor[{at}]": words[f"pulse_halfus_{rotor}"] * HALFUS for at, rotor in enumerate(MOTORS)}
    flags, phase = words["flags"], words["phase"]
    flies = (flags & FLIES) != 0
    mode = np.where((flags & LEVELS) != 0, "ANGLE_MODE", "0")
    found["flightModeFlags (flags)"] = np.where(flies, np.where(mode == "0", "ARM", "ARM|ANGLE_MODE"), mode)
    found["stateFlags (flags)"] = np.full(len(flags), "0")
    landed = (phase == STOPPED) & ((words["stop_reason"] & RECEIVER_LOST) != 0)
    phases = [phase == HELD, phase == LANDING, landed]
    found["failsafePhase (flags)"] = np.select(phases, ["RX_LOSS_DETECTED", "LANDING", "LANDED"], "IDLE")
    received = ((words["receiver"] & 255) != 0) & ((flags & LOST) == 0)
    found["rxSignalReceived"] = found["rxFlightChannelsValid"] = received.astype(np.int64)
    return found
