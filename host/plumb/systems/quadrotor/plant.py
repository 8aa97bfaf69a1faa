"""The plant of `quadrotor`: one vehicle, its sensors, its pilot and its receiver."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from plumb.spec.arrays import FloatArray
from plumb.systems.quadrotor.drawn_run import Scenario, truth_of
from plumb.systems.quadrotor.vehicle import Vehicles

IDLE_HALFUS, SPAN_HALFUS = 2000.0, 2000.0
"""The speed controllers are taught 1000 us to 2000 us."""


def command_of(pulse_halfus: npt.NDArray[np.generic]) -> FloatArray:
    """Commands of the rotors, 0 to 1, of these pulses."""
    return np.asarray(np.clip((pulse_halfus.astype(np.float64) - IDLE_HALFUS) / SPAN_HALFUS, 0.0, 1.0))


class QuadrotorPlant:
    """`follow` sets the pulses of the rotors, `counts` returns samples and commands. open_loop: an ideal controller
    flies, and the pulses are ignored."""

    def __init__(self, scenario: Scenario, *, open_loop: bool = False) -> None:
        self.scenario = scenario
        self.vehicles = Vehicles([scenario], ideal=open_loop)
        self._frozen: dict[int, int] = {}

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """Simulate up to time_s with these pulses; without any the rotors stand still."""
        pulses = [outputs[f"pulse_halfus_{rotor}"] for rotor in range(4)] if outputs else [0] * 4
        command = command_of(np.array(pulses)[:, None])
        while self.vehicles.step < round(time_s * 1e6 / self.scenario.period_us):
            self.vehicles.advance(command)

    def counts(self, time_s: float) -> tuple[int, ...]:
        """All inputs of the sample at time_s, which `follow` has reached."""
        row = [*self.vehicles.counts()[0].tolist(), *self.vehicles.commands()[0].tolist()]
        step = self.vehicles.step % self.scenario.steps
        for place, fault in enumerate(self.scenario.faults):
            if time_s >= fault.start_s:
                channel = fault.channel
                start = self._frozen.setdefault(place, row[channel])
                now = np.array([row[channel]], np.int16), np.array([time_s])
                row[channel] = int(fault.counts(*now, start, self.scenario.fault_noise[channel, step : step + 1])[0])
        return tuple(row)

    def truth(self, time_s: float) -> dict[str, float]:
        return truth_of(self.vehicles, self.scenario.faults)

    def setpoint(self, time_s: float) -> int:
        """Throttle of the receiver's last frame, Q15."""
        return int(self.vehicles.throttle_q15()[0])
