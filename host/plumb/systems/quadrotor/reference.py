"""`quadrotor` in float64: from counts, throttle and sticks to four rotors.

The vertical and the rates are those of the float64 model of attitude, which runs a step at a time: its thrust command
is the throttle of the step before, which depends on its attitude.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from plumb.spec import declarations
from plumb.spec.arrays import FloatArray
from plumb.systems.attitude.quantise import DEG
from plumb.systems.attitude.reference import ALIGNING_BLOCKS, Model
from plumb.systems.attitude.reference_state import JUDGES, Filter, Samples
from plumb.systems.quadrotor.reference_flight import TOUCHED_BLOCKS, Flight, Inputs, Phase, Seen
from plumb.systems.quadrotor.reference_rates import RateLoop, asked_rates, mix
from plumb.systems.quadrotor.tuning import QuadrotorTuning

NAMES = (
    *(f"up_{axis}" for axis in "xyz"),
    *(f"rate_{axis}_dps" for axis in "xyz"),
    *(f"asked_{axis}_dps" for axis in "xyz"),
    "thrust",
    "collective",
    *(f"rotor_{number}" for number in range(4)),
)
FULL = 2.0**15


def vertical_of(attitude: FloatArray) -> FloatArray:
    """The vertical in body axes (3,): the last row of the attitude's matrix."""
    w, x, y, z = attitude.tolist()
    return np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])


@dataclass
class Sensing:
    """The model of attitude, a step at a time, with the flags that the step reads."""

    model: Model
    samples: Samples
    x: Filter
    unsure: bool = True

    @classmethod
    def of(cls, tuning: QuadrotorTuning, counts: FloatArray) -> Sensing:
        own = replace(tuning.attitude, period_us=tuning.period_us, exact_period_s=tuning.exact_period_s)
        model = Model(own, vehicle=True)
        return cls(model, model.taken(counts, np.zeros(len(counts))), model.begun())

    def step(self, step: int, collective: float) -> Seen:
        """The estimate after the sample of this step. collective: thrust command of the step before, without what roll
        and pitch add to it; 0: the rotors are off."""
        self.samples.thrust[step] = collective
        judges = self.x.left == JUDGES
        self.x, _ = self.model.advanced(self.x, self.samples, step, step + 1)
        x = self.x
        if x.aligned_blocks < ALIGNING_BLOCKS:
            self.unsure = True
        elif judges and x.left != JUDGES:
            self.unsure = x.tilt_rad2 > 2.0 * (DEG * self.model.tuning.motion.unsure_deg) ** 2
        return Seen(
            rate_dps=x.half_before * (2.0 / self.model.period_s / DEG),
            accel_g=x.accel_before,
            up=vertical_of(x.attitude),
            missing=bool(self.samples.missing[step]),
            flight=x.flight,
            block_ends=x.block_step == 0,
            unsure=self.unsure,
        )


def inputs_of(commands: FloatArray, throttle: FloatArray) -> list[Inputs]:
    """Of every step. commands: roll, pitch, yaw, switches, receiver, (steps, 5); throttle: Q15 (steps,)."""
    shares = np.clip(throttle, 0, FULL - 1) / FULL
    rows = zip(shares.tolist(), commands[:, :3].tolist(), commands[:, 3:].astype(int).tolist(), strict=True)
    return [
        Inputs(
            throttle=share,
            sticks=(roll / FULL, pitch / FULL, yaw / FULL),
            on=bool(switches & 1),
            mode_rate=bool(switches & 2),
            number=receiver & 255,
            signs_off=bool(receiver & 256),
        )
        for share, (roll, pitch, yaw), (switches, receiver) in rows
    ]


def one_run(tuning: QuadrotorTuning, raw: FloatArray, throttle: FloatArray) -> FloatArray:
    """The columns NAMES of one run, (steps, names)."""
    sensing, flight, rates = Sensing.of(tuning, raw[:, :6]), Flight(tuning), tuning.rates
    loops = [RateLoop(gains) for gains in (rates.roll, rates.pitch, rates.yaw)]
    found, collective = np.zeros((len(raw), len(NAMES))), 0.0
    for step, given in enumerate(inputs_of(raw[:, 6:11], throttle)):
        seen = sensing.step(step, collective)
        phase = flight.step(given, seen, loops[:2])
        flies, alone = given.on and phase is not Phase.STOPPED, phase in (Phase.HELD, Phase.LANDING)
        levels, landed = alone or not given.mode_rate, seen.flight.landed
        rate_max_dps = tuning.level.rate_max_dps
        if seen.unsure:
            rate_max_dps = min(rate_max_dps, tuning.level.unsure_rate_max_dps)
        sticks = (0.0, 0.0, 0.0) if alone else given.sticks
        asked = asked_rates(tuning, sticks, levels, seen.up, rate_max_dps)
        touches = seen.flight.carried_blocks >= TOUCHED_BLOCKS
        demand = np.array([
            loop.step(rates, tuning.period_s, *both, flies=flies, landed=landed, touches=touches)
            for loop, *both in zip(loops, asked.tolist(), seen.rate_dps.tolist(), strict=True)
        ])  # fmt: skip
        mixed = mix(tuning.mixer, flight.throttle, demand, may_fly=not landed)
        thrust, flight.limited = mixed.thrust if flies else 0.0, flies and mixed.limited
        before, collective = collective, max(flight.throttle, tuning.mixer.idle, 2.0**-15) if flies else 0.0
        for loop, excess in zip(loops, (demand - mixed.got).tolist(), strict=True):
            loop.excess = excess if flies else 0.0
        found[step] = [*seen.up, *seen.rate_dps, *asked, thrust, before, *(mixed.rotors if flies else (0.0,) * 4)]
    return found


def run_control(
    tuning: QuadrotorTuning, raw: npt.ArrayLike, setpoint: npt.ArrayLike | None = None
) -> dict[str, FloatArray]:
    """From counts to rotors. raw: counts, then commands, (steps, 6 or more[, runs]), commands that are not given have
    their defaults; setpoint: throttle, Q15 (steps[, runs]), default 0.

    Returns float arrays (steps[, runs]) by name: the vertical and the rates in body axes, the rates that are asked
    for, mean and single commands of the rotors, the thrust command of attitude, 0 to 1.
    """
    given = np.asarray(raw, np.float64)
    throttle = np.zeros((len(given), *given.shape[2:]))
    if setpoint is not None:
        throttle = np.broadcast_to(np.asarray(setpoint, np.float64), throttle.shape)
    defaults = np.array(declarations.system("quadrotor").default_commands(), float)[given.shape[1] - 6 :]
    rest = np.broadcast_to(
        defaults.reshape(-1, *(1,) * (given.ndim - 2)), (len(given), len(defaults), *given.shape[2:])
    )
    whole = np.concatenate([given, rest], axis=1)
    if whole.ndim == 2:
        found = one_run(tuning, whole, throttle)
    else:
        runs = range(whole.shape[2])
        found = np.stack([one_run(tuning, whole[:, :, run], throttle[:, run]) for run in runs], axis=-1)
    return {name: found[:, i] for i, name in enumerate(NAMES)}
