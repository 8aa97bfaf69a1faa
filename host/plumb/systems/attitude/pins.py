"""`attitude` on the pins of the virtual board: gyro and accelerometer on I2C1, as two chips or as one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from plumb.f103.attached.adxl345 import Adxl345
from plumb.f103.attached.invensense import Invensense
from plumb.f103.attached.itg3205 import Itg3205
from plumb.spec import imu_chips
from plumb.systems.attitude.scenarios import ONE_CHIP, TWO_CHIPS, Scenario
from plumb.systems.contracts import Conversion
from plumb.systems.fitted_chips import fit

if TYPE_CHECKING:
    from plumb.f103.machine import Machine

SCENARIO = TWO_CHIPS
SHOWN, TUNING = SCENARIO, TWO_CHIPS
SENSOR_SETS = (TWO_CHIPS, ONE_CHIP)
SENSORS_ALIKE = {
    way.gyro.name: (ONE_CHIP, {"accel_bus": way.number})
    for way in imu_chips.ways()
    if way.gyro is way.accel and way.gyro.scales == imu_chips.chips()[ONE_CHIP].scales and way.gyro.name != ONE_CHIP
}
FRAMES = ("RAW_A", "RAW_B", *(f"ATTITUDE_QUATERNION_{axis}" for axis in "WXYZ"))


class SensedBody(Protocol):
    """A body with both sensors: it plays a scenario, or a hand holds it."""

    @property
    def scenario(self) -> Scenario: ...
    def rate_dps(self, time_s: float, /) -> tuple[float, float, float]: ...
    def force_g(self, time_s: float, /) -> tuple[float, float, float]: ...
    def truth(self, time_s: float, /) -> dict[str, float]: ...


class AttitudeCoupling:
    """Connects a plant to a machine's pins. The plant's time 0 is the first gyro sample that the board reads.

    taken: the gyro samples that the board has read, with the time of reading.
    """

    gyro: Itg3205 | Invensense
    accel: Adxl345 | Invensense

    def __init__(self, machine: Machine, plant: SensedBody) -> None:
        self.machine = machine
        self.plant = plant
        self.taken: list[Conversion] = []
        self._start: float | None = None
        if plant.scenario.name == ONE_CHIP:
            self.gyro = self.accel = fit(machine, ONE_CHIP, self._rate_dps, self._force_g)
        else:
            self.gyro, self.accel = Itg3205(machine, self._rate_dps), Adxl345(machine, self._force_g)
            machine.i2c_bus.slaves += [self.gyro, self.accel]
        self.gyro.on_read = self._read

    def _time_s(self, now_s: float) -> float:
        return 0.0 if self._start is None else max(now_s - self._start, 0.0)

    def _rate_dps(self, now_s: float) -> tuple[float, float, float]:
        return self.plant.rate_dps(self._time_s(now_s))

    def _force_g(self, now_s: float) -> tuple[float, float, float]:
        return self.plant.force_g(self._time_s(now_s))

    def _read(self, sampled_s: float, counts: tuple[int, int, int]) -> None:
        if self._start is None:
            self._start = sampled_s
        self.taken.append(Conversion(self.machine.now_s, counts[0], self.plant.truth(self._time_s(sampled_s))))


couple = AttitudeCoupling
