"""`balancer` on the pins of the virtual board: both chips on I2C1, Hall sensors on TIM2, the bridge of TIM1."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from plumb.f103.attached.adxl345 import Adxl345
from plumb.f103.attached.itg3205 import Itg3205
from plumb.f103.core.timeline import TICKS_PER_S, TICKS_PER_US
from plumb.physics.motor import hall_state, share_of_supply
from plumb.systems.balancer.plant import BalancerPlant
from plumb.systems.balancer.scenarios import GYRO_NOISE_DPS
from plumb.systems.contracts import Conversion

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SCENARIO = "rough"
SHOWN, TUNING = SCENARIO, "tuned"
FRAMES = ("RAW_A", "RAW_B", "BALANCER_ANGLE", "BALANCER_DRIVE")
BREAK_PIN = "PB12"
GYRO, HALL = 0, 3
"""Indices of their channels among the raw counts."""
CROSS_AXIS_DPS = GYRO_NOISE_DPS * np.random.default_rng(0).standard_normal((4096, 2))
"""Noise of the gyro's x and z axes in deg/s, one value per millisecond: the vehicle does not turn about them. Without
it, the stuck check of the chip would depend on the counts of the axle alone, and four equal ones occur by chance."""
FOLLOW_US = 1000
"""Interval at which the plant reads the bridge and updates the Hall sensors."""


class BalancerCoupling:
    """Connects a plant to a machine's pins. The plant's time 0 is the first gyro sample that the board reads.

    taken: the gyro samples that the board has read, with the time of reading.
    """

    def __init__(self, machine: Machine, plant: BalancerPlant) -> None:
        self.machine = machine
        self.plant = plant
        self.taken: list[Conversion] = []
        self._start: float | None = None
        self._hall_state = 0
        self._cross_axis_dps = (0.0, 0.0)
        self.gyro, self.accel = Itg3205(machine, self._rate_dps), Adxl345(machine, self._force_g)
        self.gyro.on_read = self._read
        machine.i2c_bus.slaves += [self.gyro, self.accel]
        machine.drive(BREAK_PIN, True)
        self._follow(machine.now)

    def _time_s(self, now_s: float) -> float:
        return 0.0 if self._start is None else now_s - self._start

    def _rate_dps(self, now_s: float) -> tuple[float, float, float]:
        time_s = self._time_s(now_s)
        failed = any(
            fault.channel == GYRO and fault.kind != "noisy" and fault.start_s <= time_s < fault.stop_s
            for fault in self.plant.scenario.faults
        )
        if not failed:  # a fault is of all three axes
            x_dps, z_dps = CROSS_AXIS_DPS[round(now_s * 1e3) % len(CROSS_AXIS_DPS)]
            self._cross_axis_dps = float(x_dps), float(z_dps)
        return self._cross_axis_dps[0], self.plant.felt(time_s)[0], self._cross_axis_dps[1]

    def _force_g(self, now_s: float) -> tuple[float, float, float]:
        _, forward_g, up_g = self.plant.felt(self._time_s(now_s))
        return forward_g, 0.0, up_g

    def _read(self, sampled_s: float, counts: tuple[int, int, int]) -> None:
        if self._start is None:
            self._start = sampled_s
        self.taken.append(Conversion(self.machine.now_s, counts[1], self.plant.truth(self._time_s(sampled_s))))

    def _follow(self, now: int) -> None:
        vehicle, bridge = self.plant.vehicle, self.machine.bridge()
        duty = share_of_supply(bridge.duty, vehicle.rolled_edges() / 6.0) if bridge.enabled else None
        time_s = self._time_s(now / TICKS_PER_S)
        self.plant.drive_to(time_s, duty)
        self._hall_state = self._hall(time_s)
        self.machine.set_hall(self._hall_state)
        self.machine.timeline.at("plant", now + FOLLOW_US * TICKS_PER_US, self._follow)

    def _hall(self, time_s: float) -> int:
        """State of the three Hall sensors. A fault affects all three: high, low, frozen, or with occasional extra
        edges."""
        rolled = self.plant.vehicle.rolled_edges()
        for fault in self.plant.scenario.faults:
            if fault.channel == HALL and fault.start_s <= time_s < fault.stop_s:
                match fault.kind:
                    case "railed":
                        return 7
                    case "silent":
                        return 0
                    case "stuck":
                        return self._hall_state
                    case _:
                        rolled += 1 if self.plant.fault_noise(time_s, HALL) > 0.0 else 0
        return hall_state(rolled / 6.0)


couple = BalancerCoupling
