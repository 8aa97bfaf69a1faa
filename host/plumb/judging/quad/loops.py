"""The closed loop of `quad` as a frequency response: attitude hold, broken at its command."""

from __future__ import annotations

import math
from collections.abc import Mapping

from plumb.systems.quad import plant
from plumb.systems.quad.scenarios import HOLD
from plumb.tuning.loop_model import Controller, Loop, Margins, PlantModel

TUNING = "hold"
PULSE_DELAY_S = 0.003
"""Mean time from a sample to the thrust that its pulse asks for: half of their repetition, and the pulse itself."""


def axis(delay_s: float) -> PlantModel:
    """The simulated axis about level. With pulses around 1500 us its torque is linear in the command: the squares of
    both speeds subtract, and leave 0.8 of the thrust at 1."""
    span = 2.0 * HOLD.esc.span_us / plant.PULSE_SPAN_US
    per_command_nm = span * plant.ARM_M * plant.THRUST_N
    return PlantModel(
        math.degrees(per_command_nm / plant.INERTIA_KGM2),
        plant.MOTOR_TAU_S,
        delay_s,
        plant.FRICTION_NMS / plant.INERTIA_KGM2,
    )


def margins() -> Mapping[str, Margins]:
    """Margins of every closed loop, by name."""
    loop = Loop(axis(PULSE_DELAY_S), Controller(HOLD, HOLD.trust.r_deg2))
    return {"attitude hold": loop.margins(HOLD.pid)}
