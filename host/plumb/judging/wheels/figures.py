"""Targets of `wheels` and the figures that the integers reach (see plumb.proof.figures).

Every ride is driven: the C integers in the loop, scored against the truth. The margins of balance and speed come from
the model of `balancer`, whose vehicle rolls forward as this one does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache

import numpy as np

from plumb.judging.angles import MAIN
from plumb.judging.balancer import loops
from plumb.judging.wheels import sweep
from plumb.judging.wheels.ridden import Ridden, ride
from plumb.proof import loop_figures
from plumb.proof.figures import Figure, Sense
from plumb.proof.limits import Limit, Limits
from plumb.proof.loop_figures import LeastMargins
from plumb.proof.report import Plot
from plumb.spec.arrays import FloatArray
from plumb.systems.wheels import rides
from plumb.systems.wheels import scenarios as wheels
from plumb.tuning.loop_model import Margins, nearest_margins

TUNING = wheels.DEFAULT_TUNING
ESTIMATE, VELOCITY, TURNS = "tilt error", "velocity error", "turn rate error"
HEADLINE = (ESTIMATE, "level", TUNING)
SCORED_FROM_S = 8.0
DRIVES_S = (rides.BEGINS_S, 30.0)
FELL_DEG, REST_MPS = 45.0, 0.1
LEAST = LeastMargins(phase_deg=30.0, gain_db=6.0, delay_s=0.020)
LATE_STEPS = 4
"""20 ms of further delay."""
ESTIMATE_DEG, TURN_DPS = 0.5, 4.0
RUN_DEG = 0.8
"""A single run: 1.5 times the worst of seeds 1000 to 1039, as a measured limit is."""
VELOCITY_MPS = {"level": 0.2, "slope": 0.3, "shifted": 0.3}

ASSUMED = (
    "Means over the seeds, every 5 ms; rms from 8 s on: estimated to true tilt, velocity and turn rate asked for to the"
    " true ones, steps of what is asked for included.",
    "Vehicle as `balancer` in the plane; assumed: rider 0.4 kg at 0.18 m, body 0.8 kg at 0.09 m, track 0.20 m, inertia"
    " about the vertical 0.006 kg m^2, friction 0.8, on ice 0.05; encoders of 1320 counts a turn; driver without effect"
    " below 2 % of duty and with 3 A at most; battery 0.9 to 1.1 of its nominal voltage.",
    "MPU-6050 as for `quadrotor`: bias 1 deg/s an axis, 0.5 deg/s of warm-up, scale 1 %, misalignment 0.7 %, offset"
    f" 2 mg; vibration white, {wheels.VIBRATION_G:g} g an axis. Pushes and rough ground as `balancer`.",
    "Ice: at 0.4 m/s, pushed by up to 3 m/s^2 and asked to slow to 0.1 m/s within 0.3 s of it while a wheel, or both,"
    " slip. Ice, the rider's leaving and a silence come at times drawn from the seed.",
    "Margins: about upright, the wheels rolling, both loops as models; balance broken at the duty, the speed loop"
    " closed; with 0.9 and 1.1 of the battery's voltage the worse one. tools/gen_margins.py sweeps the flash image: the"
    f" same loop of balance and that of the turn rate, at {sweep.ROLLS_MPS:g} m/s.",
)
LIMITS: Limits = {(name, TUNING, "closed"): (Limit(MAIN, "at most", RUN_DEG, "deg"),) for name in VELOCITY_MPS}


@lru_cache(maxsize=2)
def _ridden(name: str, seeds: tuple[int, ...], late_steps: int = 0) -> Ridden:
    return ride(name, seeds, late_steps=late_steps)


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _mean(claim: str, name: str, unit: str, sense: Sense, limit: float, of_runs: FloatArray) -> Figure:
    return Figure(
        claim, name, TUNING, unit, sense, limit, float(np.mean(of_runs)), float(np.max(of_runs))
    ).over(of_runs)  # fmt: skip


def _worst(claim: str, name: str, unit: str, limit: float | None, of_runs: FloatArray) -> Figure:
    """Figure of the worst seed: a row that every seed has to keep; None: it is shown."""
    sense: Sense = "shown" if limit is None else "at most"
    worst = float(np.max(of_runs))
    return Figure(f"{claim}, worst seed", name, TUNING, unit, sense, limit or 0.0, worst, worst)


def errors(name: str, seeds: Iterable[int]) -> Iterator[Figure]:
    """Tilt, velocity and turn rate of a ride."""
    ridden = _ridden(name, tuple(seeds))
    scored = ridden.between(SCORED_FROM_S, np.inf)
    velocity = ridden.velocity_mps[scored] - ridden.asked_mps[scored]
    turn = ridden.turn_dps[scored] - ridden.asked_dps[scored]
    asked = VELOCITY_MPS.get(name)
    turns = rides.RIDES[name].turns
    yield _mean(ESTIMATE, name, "deg rms", "at most", ESTIMATE_DEG, _rms(ridden.error_deg[scored]))
    yield _mean(VELOCITY, name, "m/s rms", "at most" if asked else "shown", asked or 0.0, _rms(velocity))
    yield _mean(TURNS, name, "deg/s rms", "at most" if turns else "shown", TURN_DPS if turns else 0.0, _rms(turn))
    yield _worst("largest tilt", name, "deg", None, np.abs(ridden.tilt_deg).max(axis=0))


def _up(ridden: Ridden) -> FloatArray:
    """Share of the runs that stay up, %."""
    return np.asarray(100.0 * (np.abs(ridden.tilt_deg).max(axis=0) < FELL_DEG))


def _off_ms(ridden: Ridden) -> FloatArray:
    """Time from a tilt of 45 deg until both duties are 0 for good, ms; 0 for a run that stays up."""
    beyond, driven = np.abs(ridden.tilt_deg) > FELL_DEG, ridden.duty > 0.0
    first = np.argmax(beyond, axis=0)
    last = len(driven) - np.argmax(driven[::-1], axis=0)
    return np.asarray(np.where(beyond.any(axis=0), np.maximum(last - first, 0), 0) * wheels.PERIOD_US * 1e-3)


def ice(name: str, seeds: Iterable[int]) -> Iterator[Figure]:
    """One wheel stays up; with both slipping it may fall, and is off at once."""
    ridden = _ridden(name, tuple(seeds))
    up = _up(ridden)
    asked = name == "ice-one"
    yield Figure("stay up", name, TUNING, "%", "at least" if asked else "shown", 100.0 * asked, float(np.mean(up)))
    yield _worst("largest tilt", name, "deg", None, np.abs(ridden.tilt_deg).max(axis=0))
    yield _worst("motors off after 45 deg", name, "ms", 100.0, _off_ms(ridden))


def steps_off(seeds: Iterable[int]) -> Iterator[Figure]:
    """At rest within 2 s of the rider's leaving, 0.3 s of which the switch is not believed; then off."""
    ridden = _ridden("steps-off", tuple(seeds))
    phase, speed, tilt = (
        ridden.around(values, 0.0) for values in (ridden.phase, np.abs(ridden.velocity_mps), np.abs(ridden.tilt_deg))
    )
    ends, period_s = np.argmax(phase == 0, axis=0), wheels.PERIOD_US * 1e-6
    yield _worst("motors off after the rider left", "steps-off", "s", 2.4, ends * period_s)
    last = np.array([speed[end - 1, run] for run, end in enumerate(ends)])
    yield _worst("speed before the motors are off", "steps-off", "m/s", REST_MPS, last)
    moving = speed > REST_MPS
    rest = [np.flatnonzero(moving[:end, run])[-1] + 1 if moving[:end, run].any() else 0 for run, end in enumerate(ends)]
    yield _worst("at rest (0.1 m/s) after the rider left", "steps-off", "s", 2.3, np.array(rest) * period_s)
    largest = np.array([tilt[:end, run].max() for run, end in enumerate(ends)])
    yield _worst("largest tilt until then", "steps-off", "deg", None, largest)


def topples(seeds: Iterable[int]) -> Iterator[Figure]:
    ridden = _ridden("topples", tuple(seeds))
    yield Figure("fall", "topples", TUNING, "%", "shown", 0.0, 100.0 - float(np.mean(_up(ridden))))
    yield _worst("motors off after 45 deg", "topples", "ms", 100.0, _off_ms(ridden))


def silent(seeds: Iterable[int]) -> Iterator[Figure]:
    """A receiver that falls silent for a second: it stands meanwhile, and stays up."""
    ridden = _ridden("receiver", tuple(seeds))
    yield Figure("stay up", "receiver", TUNING, "%", "at least", 100.0, float(np.mean(_up(ridden))))
    ends = rides.RIDES["receiver"].silent_s
    turn = ridden.around(np.abs(ridden.turn_dps), ends - 0.2, ends)
    yield _worst("turn rate at the end of the silence", "receiver", "deg/s", 10.0, turn.max(axis=0))


def loop_margins() -> dict[str, Margins]:
    """Margins of balance and speed, by name: the worse of both ends of the battery."""
    hz, gains = loops.loop_gains(0.0, wheels.STEERED.balance)
    return {
        name: min(
            (nearest_margins(hz, np.asarray(supply * gain)) for supply in wheels.BATTERY),
            key=lambda found: found.delay_s,
        )
        for name, gain in gains.items()
    }


def margins(seeds: Iterable[int]) -> Iterator[Figure]:
    for name, found in loop_margins().items():
        least = LEAST if name == "balance" else None
        yield from loop_figures.rows(name, found, "upright", TUNING, least, "model, every 5 ms")
    for name, found in loop_figures.identified("wheels").items():
        yield from loop_figures.rows(name, found, "upright", TUNING, LEAST, "flash image")
    late = _ridden("level", tuple(seeds), LATE_STEPS)
    yield Figure(
        "stay up with 20 ms of further delay", "level", TUNING, "%", "at least", 100.0, float(np.mean(_up(late)))
    )


def _errors(name: str) -> Callable[[Iterable[int]], Iterator[Figure]]:
    return lambda seeds: errors(name, seeds)


def _ice(name: str) -> Callable[[Iterable[int]], Iterator[Figure]]:
    return lambda seeds: ice(name, seeds)


SECTIONS: dict[str, Callable[[Iterable[int]], Iterator[Figure]]] = {
    "margins": margins,
    **{name: _errors(name) for name in ("level", "slope", "shifted", "turns")},
    "ice-one": _ice("ice-one"), "ice-both": _ice("ice-both"), "steps-off": steps_off, "topples": topples,
    "receiver": silent,
}  # fmt: skip
PLOTS: dict[str, Callable[[], Sequence[Plot]]] = {}
