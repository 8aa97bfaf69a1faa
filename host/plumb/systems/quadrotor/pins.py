"""`quadrotor` on the pins of the virtual board: an MPU-6050 on I2C1, pulses of four rotors from TIM2, the battery on
PB0."""

from __future__ import annotations

from typing import TYPE_CHECKING

from plumb.f103.attached.invensense import LSB_PER_DPS, LSB_PER_G
from plumb.f103.core.timeline import TICKS_PER_S, TICKS_PER_US
from plumb.physics.battery import BATTERY_PIN, Battery
from plumb.systems.contracts import Conversion
from plumb.systems.fitted_chips import fit
from plumb.systems.quadrotor.plant import QuadrotorPlant
from plumb.systems.quadrotor.vehicle import ROTORS_ON

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SCENARIO, SHOWN, TUNING = "idle", "calm", "hummingbird"
DRIVING = 9830, {"switches": ROTORS_ON}
"""Throttle, Q15, and commands that turn the rotors of a vehicle on its stand: 30 %."""
FRAMES = ("RAW_A", "RAW_B", "RAW_C", "RAW_D")
ROTOR_PINS = ("PA0", "PA1", "PA2", "PA3")
"""Front right, front left, rear left, rear right."""
NEUTRAL_HALFUS, SPAN_HALFUS = 2000, 2000
"""Pulse of a motor that rests, and from there to its full command."""
FOLLOW_US = 1000
"""Interval at which the plant reads the PWM pins."""
WIDEST = -1
"""Ranges that the firmware sets: 2000 deg/s, 16 g."""


class QuadrotorCoupling:
    """Connects a plant to a machine's pins. The plant's time 0 is the first sample that the board reads.

    taken: the samples that the board has read, with the time of reading and the counts of the gyro's x axis.
    """

    def __init__(self, machine: Machine, plant: QuadrotorPlant) -> None:
        self.machine = machine
        self.plant = plant
        self.taken: list[Conversion] = []
        self._start: float | None = None
        self.gyro = self.accel = fit(machine, "mpu6050", self._rate_dps, self._force_g)
        self.gyro.on_read = self._read
        self.battery, self._share = Battery(), 0.0
        machine.adc.setdefault(BATTERY_PIN, self._battery_v)
        self._follow(machine.now)

    def _battery_v(self, _now_s: float) -> float:
        return self.battery.input_v(self._share)

    def _time_s(self, now_s: float) -> float:
        return 0.0 if self._start is None else max(now_s - self._start, 0.0)

    def _sensed(self, now_s: float, first: int, per_count: float) -> tuple[float, float, float]:
        """Three axes in their unit, as whole counts: the sensor of the plant has its own noise and errors."""
        self._advance(now_s)
        x, y, z = (count / per_count for count in self.plant.counts(self._time_s(now_s))[first : first + 3])
        return x, y, z

    def _rate_dps(self, now_s: float) -> tuple[float, float, float]:
        return self._sensed(now_s, 0, LSB_PER_DPS[WIDEST])

    def _force_g(self, now_s: float) -> tuple[float, float, float]:
        return self._sensed(now_s, 3, LSB_PER_G[WIDEST])

    def _read(self, sampled_s: float, counts: tuple[int, int, int]) -> None:
        if self._start is None:
            self._start = sampled_s
        self.taken.append(Conversion(self.machine.now_s, counts[0], self.plant.truth(self._time_s(sampled_s))))

    def _advance(self, now_s: float) -> None:
        pulses = [self.machine.pwm(pin) for pin in ROTOR_PINS]
        halfus = [round(2.0 * pulse.pulse_us) if pulse.enabled else 0 for pulse in pulses]
        above = [min(max(pulse - NEUTRAL_HALFUS, 0), SPAN_HALFUS) for pulse in halfus]
        self._share = sum(above) / (len(above) * SPAN_HALFUS)
        outputs = {f"pulse_halfus_{rotor}": one for rotor, one in enumerate(halfus)}
        self.plant.follow(self._time_s(now_s), outputs)

    def _follow(self, now: int) -> None:
        self._advance(now / TICKS_PER_S)
        self.machine.timeline.at("plant", now + FOLLOW_US * TICKS_PER_US, self._follow)


couple = QuadrotorCoupling
