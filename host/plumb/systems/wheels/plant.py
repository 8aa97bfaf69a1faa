"""The plant of `wheels`: one vehicle, its sensors, its rider and its receiver."""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from plumb.physics.imu import MPU6050, Imu
from plumb.spec import declarations
from plumb.systems.balancer.vehicle import PUSH_RADPS2_PER_MPS2
from plumb.systems.prescribed import put_faults
from plumb.systems.wheels import rides
from plumb.systems.wheels.drawn_run import Prescribed, Scenario
from plumb.systems.wheels.vehicle import GRID_S, GRIP, Kerb, Outside, Vehicle

FULL_Q15, MOTORS_ON = 32767, 1
SPEED_MAX_MPS, TURN_MAX_DPS = 1.0, 90.0
"""What full sticks ask for."""
FRAME_S, NUMBERS = 1.0 / 150.0, 255
"""The receiver gets 150 frames a second (CRSF), numbered 1 to 255 in a circle."""
FAULTY = 8
"""Of the truth `happening`: the bit of a fault of channel 0."""
TAKEN = (1, 3, 5, 2)
"""Of gyro and accelerometer x, y, z: the rate about the axle, the accelerations forward and up, the rate of turning."""
Duties = tuple[float | None, float | None]


class WheelsPlant:
    """`follow` sets the duties, `counts` returns samples and commands. open_loop: an ideal controller drives, and the
    duties are ignored."""

    def __init__(self, scenario: Scenario, *, open_loop: bool = False) -> None:
        self.scenario, self._ideal = scenario, open_loop
        ride = scenario.ride
        self.vehicle = Vehicle(ride.slope_deg, ride.shift_m, scenario.supply)
        self.imu = Imu(MPU6050, scenario.imu[:, None], scenario.period_us * 1e-6)
        self.step = 0
        self._happens = ride.happens()
        self._kerbs_m: dict[int, float] = {}
        self._frozen: dict[int, int] = {}
        self._duties: Duties = (None, None)

    @property
    def time_s(self) -> float:
        """Up to which it is simulated."""
        return self.step * GRID_S

    def happens_now(self, what: str, *, seconds: float = math.inf, size: float = 0.0, number: int = 0) -> None:
        """One of rides.HAPPENINGS begins, in addition to those of the ride. Raises ValueError for an unknown one."""
        if what not in rides.HAPPENINGS:
            raise ValueError(f"nothing is called '{what}'; there are {', '.join(rides.HAPPENINGS)}")
        self._happens += (rides.Happening(what, self.time_s, self.time_s + seconds, size, number),)

    def follow(self, time_s: float, outputs: Mapping[str, int]) -> None:
        """Simulate up to time_s with these duties; without any the motors coast."""
        duties = tuple(outputs[f"duty_{side}_q15"] / 32768.0 if outputs else None for side in ("left", "right"))
        self.drive_to(time_s, (duties[0], duties[1]))

    def drive_to(self, time_s: float, duties: Duties) -> None:
        """Simulate up to time_s with these duties, -1..1 each, None: the motor coasts."""
        run, vehicle = self.scenario, self.vehicle
        while self.step < math.floor(time_s / GRID_S + 1e-6):
            now_s = self.step * GRID_S
            given = duties
            if self._ideal:
                sample = self._sample(now_s)
                riding = self.ridden(now_s)
                given = vehicle.ideal(run.asked_mps[sample] * riding, run.asked_dps[sample] * riding)
            vehicle.advance(given, self.outside(now_s))
            self.step += 1

    def outside(self, time_s: float) -> Outside:
        """What acts on the vehicle in the step that begins then."""
        rough = self.scenario.push_radps2
        push, ice, kerb, held_deg = float(rough[self.step % len(rough)]), self._icy(time_s), None, None
        for place, one in enumerate(self._happens):
            if not one.lasts(time_s):
                continue
            if one.what == rides.PUSH:
                push += PUSH_RADPS2_PER_MPS2 * one.size
            elif one.what == rides.KERB:
                kerb = Kerb(self._kerbs_m.setdefault(place, self.vehicle.way_m), float(one.number))
            elif one.what == rides.LIFT:
                held_deg = one.size
        left, right = (rides.ICE if ice & side else GRIP for side in (rides.LEFT, rides.RIGHT))
        return Outside(push, (left, right), self.ridden(time_s), time_s < rides.HELD_S, kerb, held_deg)

    def _lasts(self, what: str, time_s: float) -> rides.Happening | None:
        """The last that lasts."""
        return next((one for one in reversed(self._happens) if one.what == what and one.lasts(time_s)), None)

    def ridden(self, time_s: float) -> bool:
        """Whether the rider stands on it."""
        return self._lasts(rides.OFF, time_s) is None and self._lasts(rides.CHATTER, time_s) is None

    def _closed(self, time_s: float) -> bool:
        """Whether the rider's switch is closed."""
        chatters = self._lasts(rides.CHATTER, time_s)
        if chatters is None:
            return self.ridden(time_s)
        since_ms = int((time_s - chatters.begin_s) * 1000.0 + 1e-6) + chatters.number
        return since_ms % rides.CHATTER_MS < rides.CLOSED_MS

    def _newest_frame(self, time_s: float) -> int:
        """Number of the receiver's newest frame, and the sample at which it was sent; 0: it is not in use."""
        ride = self.scenario.ride
        if not ride.by_receiver:
            return 0
        deaf = self._lasts(rides.DEAF, time_s)
        if deaf is not None:
            time_s = deaf.begin_s
        return int(time_s / FRAME_S + 1e-6) + 1

    def asked(self, time_s: float) -> tuple[float, float]:
        """Speed in m/s and turn rate in deg/s that the person asks for."""
        sample = self._sample(time_s)
        return float(self.scenario.asked_mps[sample]), float(self.scenario.asked_dps[sample])

    def counts(self, time_s: float) -> tuple[int, ...]:
        """All inputs of the sample at time_s, which `follow` has reached."""
        run, k, six = self.scenario, self._sample(time_s), self.six_counts(time_s)
        left, right = ((count + 0x8000) % 0x10000 - 0x8000 for count in self.vehicle.counts())
        row = [*(six[place] for place in TAKEN), left, right, int(self._closed(time_s))]
        for place, fault in enumerate(run.faults):
            channel = fault.channel
            if fault.start_s <= time_s < fault.stop_s:
                start, noise = self._frozen.setdefault(place, row[channel]), run.fault_noise[channel, k]
                found = fault.counts(np.array([row[channel]]), np.array([time_s]), start, np.array([noise]))
                row[channel] = int(found[0])
        return (*row, 0, 0, *self._commands(time_s))

    def six_counts(self, time_s: float) -> list[int]:
        """Gyro and accelerometer, x, y, z each, of which a step takes four."""
        run, vehicle, k = self.scenario, self.vehicle, self._sample(time_s)
        force_g = np.array(vehicle.force_g()) + run.vibration_g[k]
        rate = np.array(vehicle.rates_dps())
        found: list[int] = self.imu.counts(time_s, rate[:, None], force_g[:, None], run.white[k][:, None])[0].tolist()
        return found

    def _commands(self, time_s: float) -> tuple[int, ...]:
        """Roll, pitch, yaw, switches, receiver, and one unused; while the receiver is silent they stay as they are."""
        frame = self._newest_frame(time_s)
        speed, turn = self.asked((frame - 1) * FRAME_S if frame else time_s)
        pitch = round(FULL_Q15 * speed / SPEED_MAX_MPS) if frame else 0
        yaw = round(FULL_Q15 * turn / TURN_MAX_DPS)
        return 0, pitch, yaw, MOTORS_ON if frame else 0, (frame - 1) % NUMBERS + 1 if frame else 0, 0

    def truth(self, time_s: float) -> dict[str, float]:
        """True tilt, gyro bias about the axle, rate, velocity, turn rate, what is asked for, and what
        happens."""
        vehicle = self.vehicle
        speed, turn = self.asked(time_s)
        return {
            "tilt_deg": math.degrees(vehicle.tilt_rad),
            "bias_dps": float(self.imu.bias_now_dps(time_s)[1, 0]),
            "rate_dps": math.degrees(vehicle.rate_radps),
            "velocity_mps": vehicle.velocity_mps,
            "turn_dps": math.degrees(vehicle.turn_radps),
            "asked_mps": speed,
            "asked_dps": turn,
            "happening": float(self._happening(time_s)),
            "icy": float(self._icy(time_s)),
            "slope_deg": math.degrees(vehicle.slope_rad()),
        }

    def _icy(self, time_s: float) -> int:
        """Bits of the wheels on ice."""
        wheels = [one.number for one in self._happens if one.what == rides.ICY and one.lasts(time_s)]
        return functools.reduce(operator.or_, wheels, 0)

    def _happening(self, time_s: float) -> int:
        """Bits of what happens: places of rides.HAPPENINGS, from FAULTY on those of channels with a fault."""
        bits = sum({1 << rides.HAPPENINGS.index(one.what) for one in self._happens if one.lasts(time_s)})
        faulty = {fault.channel for fault in self.scenario.faults if fault.start_s <= time_s < fault.stop_s}
        return bits + sum(1 << (FAULTY + channel) for channel in faulty)

    def setpoint(self, time_s: float) -> int:
        """Speed that is asked for without a receiver, Q15."""
        return 0 if self.scenario.ride.by_receiver else round(FULL_Q15 * self.asked(time_s)[0] / SPEED_MAX_MPS)

    def _sample(self, time_s: float) -> int:
        return int(time_s * 1e6 / self.scenario.period_us + 1e-6) % self.scenario.steps


def prescribed(run: Scenario) -> Prescribed:
    """The ride of the ideal controller in a run, with the faults of its sensors."""
    plant = WheelsPlant(replace(run, faults=()), open_loop=True)
    declared, raw, speed, rows = declarations.system("wheels"), [], [], []
    for time_s in run.time_s.tolist():
        plant.follow(time_s, {})
        raw.append(declared.whole_inputs(plant.counts(time_s)))
        speed.append(plant.setpoint(time_s))
        rows.append(plant.truth(time_s))
    counts = np.array(raw, np.int16)
    put_faults(counts, run.faults, run.time_s, run.fault_noise)
    truth = {name: np.array([row[name] for row in rows], np.float64) for name in rows[0]}
    return Prescribed(counts, np.array(speed, np.int32), truth)
