"""Targets of `quadrotor` and the figures that the integers reach (see plumb.proof.figures).

Every row is flown: the C integers in the loop, scored against the truth. Margins are swept in flight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache

import numpy as np

from plumb.judging.angles import MAIN
from plumb.judging.quadrotor import iris, loops
from plumb.judging.quadrotor.flown import Flown, fly
from plumb.physics.airframe import IRIS_X
from plumb.proof import loop_figures
from plumb.proof.figures import Figure, Sense
from plumb.proof.limits import Limit, Limits
from plumb.proof.loop_figures import LeastMargins
from plumb.proof.report import Plot
from plumb.spec.arrays import FloatArray
from plumb.systems.quadrotor import courses
from plumb.systems.quadrotor import scenarios as quadrotor
from plumb.systems.quadrotor.vehicle import FRAME_S

TUNING = quadrotor.DEFAULT_TUNING
ESTIMATE, FLOWN_ERROR = "estimate error", "flown error"
HEADLINE = (ESTIMATE, "wind", TUNING)
SCORED_FROM_S = 8.0
"""A second after the pilot begins."""
SETTLED_DEG = 5.0
"""A vehicle that leans by less is back to level."""

ASSUMED = (
    "Means and worst seeds, every 2.5 ms. Estimate: angle between the estimated and the true vertical;"
    " flown: between the true vertical and the one that the pilot asks for; rms from 8 s on, the worst value where a"
    " row says so.",
    "RotorS hummingbird (0.716 kg, inertia 0.007, 0.007, 0.012 kg m^2, arm 0.17 m), flown as an X. Assumed: thrust 0.6"
    " u^2 + 0.4 u of the command, ESC delay 2 ms, CdA 0.012 m^2, rotors' unbalance 0.3 g each in a hover.",
    "Tuning iris: PX4's iris (1.535 kg, inertia 0.029, 0.029, 0.055 kg m^2, thrust 28 N), its gains worked out as the"
    " hummingbird's; assumed: the same lag of the rotors, thrust curve, ESC, frame drag, and motors that turn as the"
    " mixer wants.",
    "MPU-6050: bias 1 deg/s an axis with its sign drawn, N(0.5) deg/s of warm-up, scale 1 %, misalignment 0.7 %,"
    " offset N(2 mg) after a calibration of six sides.",
    "Events, turns and landings come at times drawn from the seed.",
    f"Wind {courses.WIND_MPS:g} m/s with Dryden gusts; gust: a step of {courses.GUST_MPS:g} m/s; weak: one rotor loses"
    f" {100 * (1 - courses.WEAK_SHARE):.0f} % of its thrust; yaw: a full stick with a battery that gives 45 % of the"
    " thrust.",
    f"Margins: broken at the mixer, swept from {loops.LOW_HZ:g} to {loops.HIGH_HZ:g} Hz in a calm hover;"
    " tools/gen_margins.py sweeps the flash image.",
)
LEAST = LeastMargins(phase_deg=45.0, gain_db=8.0, delay_s=0.030)
RMS: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "calm": ((1.8, 2.5), (1.0, 0.0)),
    "wind": ((1.8, 2.5), (1.8, 2.4)),
    "two-chips": ((1.8, 2.5), (1.8, 2.4)),
}
"""Scenario -> what is asked of the mean and of the worst seed, 0: nothing: of the estimate, of the flown error."""


def _tuning(name: str) -> str:
    """That of a scenario."""
    return quadrotor.TUNING_FOR.get(name, TUNING)


LIMITS: Limits = {
    (name, _tuning(name), "closed"): (Limit(MAIN, "at most", estimate[1], "deg", "asked of the worst of 40 seeds"),)
    for name, (estimate, _) in RMS.items()
    if estimate[1]
}


def errors_side_by_side(scenario: str, tuning: str, loop: str, seeds: Iterable[int]) -> FloatArray:
    """Error of the estimate of every step and seed, deg, (steps, runs): the runs that `plumb run` makes, all at once. A
    shorter run is the beginning of a longer one."""
    return fly(scenario, seeds, quadrotor.TUNINGS[tuning], open_loop=loop == "open").error_deg


def flown_side_by_side(scenario: str, tuning: str, seeds: Iterable[int]) -> FloatArray:
    """Angle between the true vertical and the one that the pilot asks for, of every step and seed, deg, (steps, runs):
    the runs that `plumb run` makes in closed loop."""
    return fly(scenario, seeds, quadrotor.TUNINGS[tuning]).apart_deg


@lru_cache(maxsize=4)
def _flown(name: str, seeds: tuple[int, ...]) -> Flown:
    return fly(name, seeds, quadrotor.TUNINGS[_tuning(name)])


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _asked(claim: str, name: str, unit: str, limit: float, values: FloatArray) -> Figure:
    """Figure of the worst seed: a row that every seed has to keep."""
    sense: Sense = "at most" if limit else "shown"
    return Figure(claim, name, _tuning(name), unit, sense, limit, float(np.max(values)), float(np.max(values)))


def errors(name: str, seeds: Iterable[int]) -> Iterator[Figure]:
    """Estimate and flown error of a flight."""
    flown = _flown(name, tuple(seeds))
    scored = flown.between(SCORED_FROM_S, np.inf)
    nothing = ((0.0, 0.0), (0.0, 0.0))
    for claim, values, (mean, worst) in zip(
        (ESTIMATE, FLOWN_ERROR), (flown.error_deg, flown.apart_deg), RMS.get(name, nothing), strict=True
    ):
        of_runs = _rms(values[scored])
        sense: Sense = "at most" if mean else "shown"
        yield Figure(
            claim, name, _tuning(name), "deg", sense, mean, float(np.mean(of_runs)), float(np.max(of_runs))
        ).over(of_runs)
        if worst:
            yield _asked(f"{claim}, worst seed", name, "deg", worst, of_runs)


def _leant(flown: Flown) -> Iterator[tuple[str, FloatArray]]:
    """How well each run of `lean` took and held its lean, deg."""
    begin = courses.ACTS_S
    ends = begin + courses.LEAN_S
    held = np.abs(flown.around(flown.lean_deg, begin + 0.4, ends) - courses.LEAN_DEG).max(axis=0)
    over = flown.around(flown.lean_deg, begin, ends).max(axis=0) - courses.LEAN_DEG
    yield "off 20 deg from 0.4 s on, worst", held
    yield "beyond 20 deg, worst", np.maximum(over, 0.0)


def lean(seeds: Iterable[int]) -> Iterator[Figure]:
    for claim, values in _leant(_flown("lean", tuple(seeds))):
        yield _asked(claim, "lean", "deg", 2.0, values)


def rate(seeds: Iterable[int]) -> Iterator[Figure]:
    flown = _flown("rate", tuple(seeds))
    turn = courses.COURSES["rate"].turns[0]
    rolled = flown.around(flown.rate_dps[:, 0], turn.begin_s, turn.end_s)
    from_stick_s = np.argmax(rolled > 0.9 * courses.STEP_DPS, axis=0) * quadrotor.PERIOD_US * 1e-6
    begins_s = np.searchsorted(flown.time_s, turn.begin_s + flown.later_s - 1e-9) * quadrotor.PERIOD_US * 1e-6
    from_frame_s = begins_s + from_stick_s - _frame_step_s(turn.begin_s + flown.later_s)
    yield _asked("90 % of 200 deg/s after the receiver's frame, worst", "rate", "s", 0.080, from_frame_s)
    yield _asked("90 % of 200 deg/s after the stick moved, worst", "rate", "s", 0.0, from_stick_s)
    yield _asked("beyond 200 deg/s, worst", "rate", "%", 15.0, 100.0 * (rolled.max(axis=0) / courses.STEP_DPS - 1.0))


def _frame_step_s(moved_s: FloatArray) -> FloatArray:
    """The step at which the receiver has the first frame behind a stick's move."""
    period_s = quadrotor.PERIOD_US * 1e-6
    frame_s = np.ceil(moved_s / FRAME_S - 1e-6) * FRAME_S
    return np.asarray(np.ceil(frame_s / period_s - 1e-6) * period_s)


def _back_s(lean_deg: FloatArray) -> FloatArray:
    """Time after which each run stays within SETTLED_DEG; lean_deg: from the event on, (steps, runs)."""
    outside = lean_deg > SETTLED_DEG
    last = len(outside) - np.argmax(outside[::-1], axis=0)
    return np.asarray(np.where(outside.any(axis=0), last, 0) * quadrotor.PERIOD_US * 1e-6)


def _lost_m(flown: Flown, begin_s: float) -> FloatArray:
    """The height that each run loses from a time of its course on."""
    return np.asarray(np.maximum(courses.HEIGHT_M - flown.around(flown.height_m, begin_s).min(axis=0), 0.0))


def tip(seeds: Iterable[int]) -> Iterator[Figure]:
    flown = _flown("tip", tuple(seeds))
    leaning = flown.around(flown.lean_deg, courses.COURSES["tip"].turns[0].end_s)
    yield Figure("lean at the switch to level", "tip", TUNING, "deg", "shown", 0.0, float(np.mean(leaning[0])))
    yield _asked("back within 5 deg, worst", "tip", "s", 0.7, _back_s(leaning))


def kick(seeds: Iterable[int]) -> Iterator[Figure]:
    flown = _flown("kick", tuple(seeds))
    leaning = flown.around(flown.lean_deg, courses.HAPPENS_S)
    yield Figure("largest lean", "kick", TUNING, "deg", "shown", 0.0, float(np.mean(leaning.max(axis=0))))
    yield _asked("back within 5 deg, worst", "kick", "s", 1.2, _back_s(leaning))
    yield _asked("height lost, worst", "kick", "m", 0.6, _lost_m(flown, courses.HAPPENS_S))


def gust(seeds: Iterable[int]) -> Iterator[Figure]:
    flown = _flown("gust", tuple(seeds))
    yield _asked("flown error, worst", "gust", "deg", 4.0, flown.around(flown.apart_deg, courses.HAPPENS_S).max(axis=0))


def weak(seeds: Iterable[int]) -> Iterator[Figure]:
    flown = _flown("weak", tuple(seeds))
    apart = flown.around(flown.apart_deg, courses.HAPPENS_S)
    yield _asked("flown error, worst", "weak", "deg", 5.0, apart.max(axis=0))
    yield _asked("height lost, worst", "weak", "m", 0.8, _lost_m(flown, courses.HAPPENS_S))


def yaw(seeds: Iterable[int]) -> Iterator[Figure]:
    flown = _flown("yaw", tuple(seeds))
    begin = courses.ACTS_S
    apart = flown.around(flown.apart_deg, begin, begin + 4.0)
    yield _asked("flown error, worst", "yaw", "deg", 3.0, apart.max(axis=0))


def flip(name: str, seeds: Iterable[int]) -> Iterator[Figure]:
    """Whole turns: back to level, how soon, and the height that it costs."""
    flown = _flown(name, tuple(seeds))
    turn = courses.COURSES[name].turns[0]
    yield _asked("back within 5 deg, worst", name, "s", 0.0, _back_s(flown.around(flown.lean_deg, turn.end_s)))
    yield _asked("height lost, worst", name, "m", 0.0, _lost_m(flown, turn.begin_s))


def margins(_seeds: Iterable[int]) -> Iterator[Figure]:
    for period_us in (quadrotor.PERIOD_US, 2 * quadrotor.PERIOD_US):
        how = f"swept in flight, every {1e-3 * period_us:g} ms"
        least = LEAST if period_us == quadrotor.PERIOD_US else None
        for axis in loops.PATTERNS:
            yield from loop_figures.rows(axis, loops.margins(axis, period_us=period_us), "hover", TUNING, least, how)
    for axis, found in loop_figures.identified("quadrotor").items():
        yield from loop_figures.rows(axis, found, "hover", TUNING, LEAST, "flash image")


def other_frame(seeds: Iterable[int]) -> Iterator[Figure]:
    """The iris, reported alone."""
    of_seeds, tuning = tuple(seeds), iris.tuning()
    wind = fly("wind", of_seeds, tuning, frame=IRIS_X)
    scored = wind.between(SCORED_FROM_S, np.inf)
    for claim, values in ((ESTIMATE, wind.error_deg), (FLOWN_ERROR, wind.apart_deg)):
        of_runs = _rms(values[scored])
        mean, worst = float(np.mean(of_runs)), float(np.max(of_runs))
        yield Figure(claim, "wind", iris.NAME, "deg", "shown", 0.0, mean, worst).over(of_runs)
    for claim, values in _leant(fly("lean", of_seeds, tuning, frame=IRIS_X)):
        worst = float(np.max(values))
        yield Figure(claim, "lean", iris.NAME, "deg", "shown", 0.0, worst, worst)
    for axis in loops.PATTERNS:
        found = loops.margins(axis, tuning, frame=IRIS_X)
        yield from loop_figures.rows(axis, found, "hover", iris.NAME, None, "swept in flight, every 2.5 ms")


def _errors(name: str) -> Callable[[Iterable[int]], Iterator[Figure]]:
    return lambda seeds: errors(name, seeds)


def _flip(name: str) -> Callable[[Iterable[int]], Iterator[Figure]]:
    return lambda seeds: flip(name, seeds)


SECTIONS: dict[str, Callable[[Iterable[int]], Iterator[Figure]]] = {
    **{name: _errors(name) for name in ("calm", "wind", "two-chips", "take-off", "sticks")},
    "lean": lean, "rate": rate, "tip": tip, "kick": kick, "gust": gust, "weak": weak, "yaw": yaw,
    "flip": _flip("flip"), "overturned": _flip("overturned"), "margins": margins, "iris": other_frame,
}  # fmt: skip
PLOTS: dict[str, Callable[[], Sequence[Plot]]] = {}
