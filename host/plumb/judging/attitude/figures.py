"""Figures of `attitude` on simulated motion; `plumb compare` has those on recordings and of published algorithms.

No source gives figures for this motion. The targets are the project's own: half a degree in the hand, and an arithmetic
whose error is negligible next to that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from plumb.boards.native import core as native_core
from plumb.contract import run_reference
from plumb.contract.parameters import ControlParams, quantise
from plumb.proof.figures import Figure, Sense
from plumb.proof.limits import Limits
from plumb.proof.report import Plot
from plumb.spec.arrays import FloatArray
from plumb.systems.attitude import scenarios as attitude

ERROR, APART = "error of the vertical", "integers against float64"
HEADLINE = (ERROR, attitude.DEFAULT_SCENARIO, attitude.DEFAULT_TUNING)
TO_REACH_DEG = {attitude.DEFAULT_SCENARIO: 0.5}
"""Scenario -> target; of the others the figure is shown."""
APART_DEG = 0.02
OWN_TUNING = {name: name for name in attitude.SENSORS}
"""Scenario -> its tuning; of all others the default one."""

ASSUMED = (
    "Angle between estimated and true vertical, rms over t >= 10 s; the heading does not count. `accel` is the vertical"
    " of the accelerometer alone.",
    "Tuned on recordings, not on this motion. Sensors of the scenarios that name none:"
    f" bias {attitude.STANDARD.bias_dps:g} deg/s, warm-up {attitude.STANDARD.warm_up_dps:g} deg/s,"
    f" scale {100 * attitude.STANDARD.scale:g} %, axes off by {1e3 * attitude.STANDARD.square_rad:g} mrad,"
    f" noise {attitude.STANDARD.noise_dps:g} deg/s/sqrt(Hz);"
    f" accelerometer offset {1e3 * attitude.STANDARD.accel_offset_g:g} mg,"
    f" noise {1e6 * attitude.STANDARD.accel_noise_g:g} ug/sqrt(Hz).",
    f"{APART}: rms angle between both verticals on the same counts, from the first sample on.",
)

LIMITS: Limits = {}
"""Empty: the targets are means over many seeds."""


def integers(params: ControlParams, run: attitude.Scenario) -> FloatArray:
    """The vertical of the C integers, (3, steps)."""
    words = native_core.run_control(params, run.counts(), run.setpoint())
    return np.stack([words[f"up_q30_{i}"] for i in range(3)]) / 2.0**30


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def rows_of(name: str, seeds: Iterable[int]) -> Iterator[Figure]:
    """Error of one scenario, and for the default one what the integers cost."""
    tuning, headline = OWN_TUNING.get(name, attitude.DEFAULT_TUNING), name == attitude.DEFAULT_SCENARIO
    found, alone, ideal, apart = [], [], [], []
    for seed in seeds:
        run = attitude.scenario(name, seed)
        params = quantise(run.fit(attitude.TUNINGS[tuning]))
        up = integers(params, run)
        found.append(_rms(attitude.apart_deg(up, run.vertical)[run.scored]))
        alone.append(_rms(attitude.apart_deg(run.sensed_g, run.vertical)[run.scored]))
        if headline:
            columns = run_reference.run_control(params, run.counts())
            exact = np.stack([columns[f"up_{axis}"] for axis in "xyz"])
            ideal.append(_rms(attitude.apart_deg(exact, run.vertical)[run.scored]))
            apart.append(_rms(attitude.apart_deg(up, exact)))
    sense: Sense = "at most" if name in TO_REACH_DEG else "shown"
    yield Figure(
        ERROR, name, tuning, "deg", sense, TO_REACH_DEG.get(name, 0.0), float(np.mean(found)), float(np.max(found)),
        float(np.mean(ideal)) if ideal else None, float(np.mean(alone)),
    ).over(np.array(found))  # fmt: skip
    if headline:
        cost = Figure(APART, name, tuning, "deg", "at most", APART_DEG, float(np.mean(apart)), float(np.max(apart)))
        yield cost.over(np.array(apart))


def _section(name: str) -> Callable[[Iterable[int]], Iterator[Figure]]:
    return lambda seeds: rows_of(name, seeds)


SECTIONS: dict[str, Callable[[Iterable[int]], Iterator[Figure]]] = {name: _section(name) for name in attitude.SCENARIOS}
PLOTS: dict[str, Callable[[], Sequence[Plot]]] = {}
