"""The plant of `balancer`: the vehicle and its sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from plumb.physics.sensors import Adxl345, Itg3205
from plumb.systems.balancer.drawn_run import Scenario
from plumb.systems.balancer.vehicle import GRID_S, Vehicle

UNIT_PER_COUNT = (1.0 / Itg3205().lsb_per_dps, Adxl345().g_per_lsb, Adxl345().g_per_lsb)
"""deg/s and g per count of the chips: gyro, forward, up."""


class BalancerPlant:
    """A vehicle and its sensors: `follow` sets the duty, `counts` returns samples, `truth` the true state for scoring.

    open_loop: the ideal controller drives, and the duty is ignored.
    """

    def __init__(self, scenario: Scenario, *, open_loop: bool = False) -> None:
        self.scenario = scenario
        self.vehicle = Vehicle(scenario, open_loop=open_loop)
        self._frozen: dict[int, int] = {}
        self._setpoint = scenario.setpoint()

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self.vehicle.step * GRID_S

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """Simulate up to time_s at the duty of `outputs` (duty_q15; the bridge is open without one)."""
        self.drive_to(time_s, outputs["duty_q15"] / 32768.0 if outputs else None)

    def drive_to(self, time_s: float, duty: float | None) -> None:
        """Simulate up to time_s at a duty of -1..1, or with the bridge open."""
        for _ in range(math.floor(time_s / GRID_S + 1e-6) - self.vehicle.step):
            self.vehicle.advance(duty)

    def counts(self, time_s: float) -> tuple[int, ...]:
        """Six raw counts, four used: gyro, forward, up, Hall edges; of time_s, which `follow` has reached."""
        k = np.array([self._sample(time_s)])
        vehicle = self.vehicle
        rate_dps, force_g = np.array([math.degrees(vehicle.rate_radps)]), np.array(vehicle.force_g())[:, None]
        row = self.scenario.sensed(k, rate_dps, force_g, np.array([vehicle.hall_edges()]))
        return tuple(int(count) for count in self.scenario.faulted(row, k, np.array([time_s]), self._frozen)[0])

    def felt(self, time_s: float) -> tuple[float, float, float]:
        """Inputs of the chips at time_s, with noise and this run's faults: rate about the axle in deg/s, specific force
        forward and up in g."""
        vehicle = self.vehicle
        rate_dps, force_g = np.array([math.degrees(vehicle.rate_radps)]), np.array(vehicle.force_g())[:, None]
        gyro_dps, accel_g = self.scenario.felt(np.array([self._sample(time_s)]), rate_dps, force_g)
        felt = [float(gyro_dps[0]), float(accel_g[0, 0]), float(accel_g[1, 0])]
        for fault in self.scenario.faults:
            if fault.channel < len(felt) and fault.start_s <= time_s < fault.stop_s:
                felt[fault.channel] = self.counts(time_s)[fault.channel] * UNIT_PER_COUNT[fault.channel]
        return felt[0], felt[1], felt[2]

    def fault_noise(self, time_s: float, channel: int) -> float:
        """Noise of a fault for the sample at time_s, unit variance."""
        return float(self.scenario.fault_noise[channel, self._sample(time_s)])

    def truth(self, time_s: float) -> dict[str, float]:
        """True tilt, gyro bias of the sample at time_s, rate, velocity, and the velocity setpoint."""
        vehicle = self.vehicle
        return {
            "tilt_deg": math.degrees(vehicle.tilt_rad),
            "bias_dps": float(self.scenario.bias_dps[self._sample(time_s)]),
            "rate_dps": math.degrees(vehicle.rate_radps),
            "velocity_mps": vehicle.velocity_mps,
        }

    def setpoint(self, time_s: float) -> int:
        """Velocity setpoint at time_s, m/s Q26."""
        return int(self._setpoint[self._sample(time_s)])

    def _sample(self, time_s: float) -> int:
        return round(time_s * 1e6 / self.scenario.period_us) % self.scenario.steps
