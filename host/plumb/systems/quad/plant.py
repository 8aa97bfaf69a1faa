"""Plant of `quad`: one axis, turned by two opposing motors with ESCs or held by hand, with its sensors.

The axis turns about a pivot through the centre of gravity, so that gravity makes no torque and the accelerometer sees
gravity as in the open-loop scenarios; stops limit it to +-60 deg. Every number below is assumed: the paper gives none.

    w_i' = (u_i - w_i) / tau                   motor speed, 0..1, follows the throttle u = (pulse - 1000 us) / 1000 us
    torque = arm * thrust * (w_0^2 - w_1^2) - friction * theta' + imbalance + gusts
    inertia * theta'' = torque

The hand does not let go before a motor has been driven: a board that is armed later finds the axis where it was.

Time is simulated in steps of GRID_S. Voltages are constant within a step and noise within a control period, so the
result does not depend on how often the pins are read.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from plumb.physics.sensors import Fault, OnePole, adc_counts
from plumb.systems.quad.drawn_run import CHANNELS, Scenario
from plumb.systems.quad.lateral import GRID_S

INERTIA_KGM2 = 0.015
ARM_M = 0.225
THRUST_N = 5.0
MOTOR_TAU_S = 0.05
FRICTION_NMS = 0.0075
IMBALANCE_NM = 0.02
"""Constant torque, standard deviation over seeds."""
GUST_NM, GUST_TAU_S = 0.02, 0.5
"""First-order noise, rms and time constant."""
STOP_DEG = 60.0
PULSE_ZERO_US, PULSE_SPAN_US = 1000.0, 1000.0


class QuadPlant:
    """One run of the axis: `advance_to` sets the pulses, `volts` or `counts` return samples; tilt_deg and rate_dps are
    the true values.

    open_loop: the axis follows the scenario's prescribed motion whatever the motors do. After the end of the scenario
    the prescribed motion stays at its last value, and noise repeats.
    """

    def __init__(self, scenario: Scenario, *, open_loop: bool = False) -> None:
        self.scenario = scenario
        self.open_loop = open_loop
        self._low_pass = OnePole.of(scenario.accelerometer.bandwidth_hz, GRID_S)
        self._prescribed_deg = scenario.prescribed_deg.tolist()
        self._lateral_g = scenario.lateral_g.tolist()
        self._hand = scenario.hand.tolist()
        self._imbalance_nm = IMBALANCE_NM * float(scenario.torque_noise[0])
        self._gust_drive = scenario.torque_noise[1:].tolist()
        self._gust_nm = 0.0
        self._step = 0
        self._speed = [0.0, 0.0]
        self._on_the_way = deque([[0.0, 0.0]] * round(scenario.delay_s / GRID_S))
        self._frozen: dict[Fault, float] = {}
        self._driven = False
        self.tilt_deg = self._prescribed_deg[0]
        self.rate_dps = 0.0
        self._force = self._force_filtered = self._specific_force(0)

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self._step * GRID_S

    @property
    def speed(self) -> tuple[float, float]:
        """Motor speeds, 0..1."""
        return self._speed[0], self._speed[1]

    def bias_dps(self, time_s: float) -> float:
        """True gyro bias of the sample taken at that time."""
        return float(self.scenario.bias_dps[self._sample(time_s)])

    def setpoint(self, time_s: float) -> int:
        """Setpoint of the loop at time_s, turn_q32."""
        setpoints_deg = self.scenario.setpoint_deg
        return round(float(setpoints_deg[min(round(time_s / GRID_S), len(setpoints_deg) - 1)]) / 360.0 * 2**32)

    def truth(self, time_s: float) -> dict[str, float]:
        """True values of the estimated quantities at time_s, which `advance_to` must have reached."""
        return {"tilt_deg": self.tilt_deg, "bias_dps": self.bias_dps(time_s)}

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """Simulate up to time_s with the outputs of the last step; before the first step the motors stand."""
        pulses = (outputs.get("pulse_halfus_0", 0), outputs.get("pulse_halfus_1", 0))
        self.advance_to(time_s, [pulse / 2.0 for pulse in pulses])

    def advance_to(self, time_s: float, pulse_us: Sequence[float]) -> None:
        """Simulate up to time_s with these two ESC pulses, which reach the motors after the scenario's delay; below
        1000 us, or none at all (0), the motor stands."""
        throttle = [min(max((pulse - PULSE_ZERO_US) / PULSE_SPAN_US, 0.0), 1.0) for pulse in pulse_us]
        keep = math.exp(-GRID_S / MOTOR_TAU_S)
        for _ in range(math.floor(time_s / GRID_S + 1e-6) - self._step):
            self._on_the_way.append(throttle)
            arrived = self._on_the_way.popleft()
            self._driven = self._driven or any(arrived)
            self._speed = [u + (w - u) * keep for u, w in zip(arrived, self._speed, strict=True)]
            self._advance()

    def volts(self, time_s: float) -> tuple[float, float, float]:
        """Pin volts of gyro, y and z at time_s, which `advance_to` must have reached."""
        k = np.array([self._sample(time_s)])
        y_g, z_g = self._force_filtered
        clean = self.scenario.sensed(k, np.array([self.rate_dps]), np.array([y_g]), np.array([z_g]))
        gyro_v, y_v, z_v = self.scenario.faulted(clean, k, np.array([time_s]), self._frozen)[0]
        return float(gyro_v), float(y_v), float(z_v)

    def counts(self, time_s: float) -> tuple[int, ...]:
        """Six raw counts, three used: the ADC's conversion of `volts`."""
        return (*(int(c) for c in adc_counts(self.volts(time_s))), *(0,) * (6 - CHANNELS))

    def _sample(self, time_s: float) -> int:
        return round(time_s * 1e6 / self.scenario.period_us) % self.scenario.steps

    def _advance(self) -> None:
        self._step += 1
        n, last = self._step, len(self._hand) - 1
        if self.open_loop or self._hand[min(n, last)] or not self._driven:
            before, after = self._prescribed_deg[min(n - 1, last)], self._prescribed_deg[min(n + 1, last)]
            self.tilt_deg = self._prescribed_deg[min(n, last)]
            self.rate_dps = (after - before) / (2.0 * GRID_S)
        else:
            keep = math.exp(-GRID_S / GUST_TAU_S)
            self._gust_nm = keep * self._gust_nm + GUST_NM * math.sqrt(1.0 - keep * keep) * self._gust_drive[n % last]
            turning_nm = ARM_M * THRUST_N * (self._speed[0] ** 2 - self._speed[1] ** 2)
            friction_nm = FRICTION_NMS * math.radians(self.rate_dps)
            torque_nm = turning_nm - friction_nm + self._imbalance_nm + self._gust_nm + self._pushed_nm()
            self.rate_dps += math.degrees(torque_nm / INERTIA_KGM2) * GRID_S
            self.tilt_deg += self.rate_dps * GRID_S
            if abs(self.tilt_deg) > STOP_DEG:
                self.tilt_deg, self.rate_dps = math.copysign(STOP_DEG, self.tilt_deg), 0.0
        force, pole = self._specific_force(n), self._low_pass
        self._force_filtered = (
            pole.decay * self._force_filtered[0] + pole.new * force[0] + pole.old * self._force[0],
            pole.decay * self._force_filtered[1] + pole.new * force[1] + pole.old * self._force[1],
        )
        self._force = force

    def _pushed_nm(self) -> float:
        time_s = (self._step - 1) * GRID_S  # beginning of the present step
        return sum(push.size for push in self.scenario.pushes if push.start_s <= time_s < push.stop_s)

    def _specific_force(self, n: int) -> tuple[float, float]:
        tilt_rad = math.radians(self.tilt_deg)
        return math.sin(tilt_rad) + self._lateral_g[n % (len(self._lateral_g) - 1)], math.cos(tilt_rad)
