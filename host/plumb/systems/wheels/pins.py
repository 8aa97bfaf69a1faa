"""`wheels` on the pins of the virtual board: an MPU-6050 on I2C1, encoders on TIM2 and TIM4, the rider's switch on PA3,
the battery on PA2, and two motors behind drivers with PWM (TIM1) and direction."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.attached.invensense import LSB_PER_DPS, LSB_PER_G
from plumb.f103.core.timeline import TICKS_PER_S, TICKS_PER_US
from plumb.physics.battery import Battery
from plumb.systems.contracts import Conversion
from plumb.systems.fitted_chips import fit
from plumb.systems.wheels.plant import TAKEN, WheelsPlant

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SCENARIO = "level"
SHOWN, TUNING = SCENARIO, "steered"
FRAMES = ("RAW_A", "RAW_B", "RAW_C", "RAW_D", "RAW_E", "WHEELS_DRIVE", "WHEELS_ANGLE")
BREAK_PIN, BATTERY_PIN, RIDER_PIN = "PB12", "PA2", "PA3"
MOTORS = (("PB14", "PA8", "PB13"), ("PB15", "PB0", "PB1"))
"""PWM, direction forward, direction backward of the left and of the right motor."""
ENCODERS = ("TIM2", "TIM4")
"""Of the left and of the right wheel."""
REST_V = 7.4
FOLLOW_US = 1000
"""Interval at which the plant reads the motors and turns the encoders."""
WIDEST = -1
"""Ranges that the firmware sets: 2000 deg/s, 16 g."""


class WheelsCoupling:
    """Connects a plant to a machine's pins. The plant's time 0 is the first sample that the board reads.

    taken: the samples that the board has read, with the time of reading and the counts of the gyro about the axle.
    """

    def __init__(self, machine: Machine, plant: WheelsPlant) -> None:
        self.machine = machine
        self.plant = plant
        self.taken: list[Conversion] = []
        self._start: float | None = None
        self._counted = list(plant.vehicle.counts())
        self.gyro = self.accel = fit(machine, "mpu6050", self._rate_dps, self._force_g)
        self.gyro.on_read = self._read
        self.battery, self._share = Battery(REST_V), 0.0
        machine.adc.setdefault(BATTERY_PIN, self._battery_v)
        machine.drive(BREAK_PIN, True)
        self._follow(machine.now)

    def _battery_v(self, _now_s: float) -> float:
        return self.battery.input_v(self._share)

    def _time_s(self, now_s: float) -> float:
        return 0.0 if self._start is None else max(now_s - self._start, 0.0)

    def _six(self, now_s: float) -> list[int]:
        """Whole counts of the chip: the sensor of the plant has its own noise, errors and faults."""
        self._advance(now_s)
        time_s = self._time_s(now_s)
        six, channels = list(self.plant.six_counts(time_s)), self.plant.counts(time_s)
        for place, axis in enumerate(TAKEN):
            six[axis] = channels[place]
        return six

    def _rate_dps(self, now_s: float) -> tuple[float, float, float]:
        x, y, z = (count / LSB_PER_DPS[WIDEST] for count in self._six(now_s)[:3])
        return x, y, z

    def _force_g(self, now_s: float) -> tuple[float, float, float]:
        x, y, z = (count / LSB_PER_G[WIDEST] for count in self._six(now_s)[3:])
        return x, y, z

    def _read(self, sampled_s: float, counts: tuple[int, int, int]) -> None:
        if self._start is None:
            self._start = sampled_s
        self.taken.append(Conversion(self.machine.now_s, counts[1], self.plant.truth(self._time_s(sampled_s))))

    def _duty(self, pwm: str, forward: str, backward: str) -> float | None:
        """Of a motor, as its driver takes it; None: it coasts, as without direction."""
        share = self.machine.duty(pwm)
        ahead, back = self.machine.pin(forward) is True, self.machine.pin(backward) is True
        return None if ahead == back or share is None else share * (1.0 if ahead else -1.0)

    def _advance(self, now_s: float) -> None:
        left, right = (self._duty(*pins) for pins in MOTORS)
        self._share = (abs(left or 0.0) + abs(right or 0.0)) / 2.0
        time_s = self._time_s(now_s)
        self.plant.drive_to(time_s, (left, right))
        channels = self.plant.counts(time_s)
        self.machine.drive(RIDER_PIN, channels[6] <= 0)
        for wheel, timer in enumerate(ENCODERS):
            turned = (channels[4 + wheel] - self._counted[wheel] + 0x8000) % 0x10000 - 0x8000
            self._counted[wheel] += turned
            self.machine.turn_encoder(timer, turned)

    def _follow(self, now: int) -> None:
        self._advance(now / TICKS_PER_S)
        self.machine.timeline.at("plant", now + FOLLOW_US * TICKS_PER_US, self._follow)


couple = WheelsCoupling
