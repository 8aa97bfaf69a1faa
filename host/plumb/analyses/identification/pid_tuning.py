"""From a test of the loop to gains with margins, and the test again with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from plumb.analyses.identification import chosen_settings, pid_design, plant_fit
from plumb.analyses.identification.flown_loop import FlownRun
from plumb.analyses.identification.loop_test import LoopRun
from plumb.analyses.identification.pid_design import Design, Wanted
from plumb.analyses.identification.plant_fit import PlantFit
from plumb.analyses.identification.tested_loop import Gains, TestedLoop
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import AnyTuning
from plumb.tuning.loop_model import Loop, Margins

FASTER = (2, 4)
"""Parts of the period at which gains are worked out, too."""
SHORTEST_US = 500


@dataclass(frozen=True)
class PidTuning:
    """The loop that was tested, its margins with the gains of now, and the gains that have the wanted ones. parts:
    margins of the loop in its other modes, before and after. faster: period in us -> what gains for shorter steps would
    reach."""

    run: LoopRun | FlownRun
    plant: PlantFit
    loop: Loop[Gains]
    before: Margins
    wanted: Wanted
    design: Design[Gains]
    parts: list[tuple[Margins, Margins]]
    faster: dict[int, Design[Gains]]

    @property
    def tested(self) -> TestedLoop[Gains]:
        return self.run.tested

    @property
    def tuning(self) -> AnyTuning:
        return self.tested.tuning

    @property
    def tuned(self) -> AnyTuning:
        return self.tested.tuned(self.design.gains)

    def settings_before(self) -> dict[str, float]:
        """The gains of the test by whole name."""
        return self.tested.named(self.tested.gains)

    def settings(self) -> dict[str, float]:
        """The new gains by whole name."""
        return self.tested.named(self.design.gains)

    def refusal(self) -> str:
        """Why the gains are not offered; "" if they are."""
        if not self.design.met:
            return "no gains reach the margins that are wanted at this period: ask for less, or take shorter steps"
        return chosen_settings.refusal(self.tuned)


def tune(run: LoopRun | FlownRun, wanted: Wanted, *, design: bool = True) -> PidTuning:
    """Identify the plant, work out its margins, and design gains; design: False keeps those of the run. Raises
    UsageError for a test that says too little."""
    tested, plant = run.tested, plant_fit.fit(run.measurement())
    gains, search = tested.gains, tested.search()
    loop = tested.loop(plant.plant, run)
    before = loop.margins(gains)
    found = Design(gains, before, pid_design.meets(before, wanted), 0.0)
    faster = {}
    if design:
        found = pid_design.design(loop, gains, wanted, search)
        for part in FASTER:
            period_us = tested.tuning.period_us // part
            if period_us >= SHORTEST_US:
                shorter = tested.loop(plant.plant, run, period_us)
                faster[period_us] = pid_design.design(shorter, found.gains, wanted, search)
    pairs = zip(search.parts(gains), search.parts(found.gains), strict=True)
    parts = [(loop.margins(old), loop.margins(new)) for old, new in pairs]
    return PidTuning(run, plant, loop, before, wanted, found, parts, faster)


def hold_rms(run: LoopRun | FlownRun, seconds: float) -> float | None:
    """Rms of the true tilt, or what else the loop holds, in the last seconds before the test signal, while the setpoint
    is 0; None on a machine."""
    if not len(run.truth_deg):
        return None
    end = run.begin - len(run.excitation.setpoint_deg)
    return float(np.sqrt(np.mean(run.truth_deg[end - round(seconds / run.excitation.period_s) : end] ** 2)))


def step_response(loop: Loop[Gains], gains: Gains, seconds: float, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Tilt after a step of the setpoint by 1, at the samples, by the inverse transform of the closed loop: a step that
    goes up and down again, each after the loop has settled."""
    samples = 2 * max(64, round(8.0 * seconds / period_s))
    hz: FloatArray = np.asarray(np.fft.rfftfreq(samples, period_s)[1:], np.float64)
    closed = loop.closed(hz, gains)
    square = np.where(np.arange(samples) < samples // 2, 0.5, -0.5)
    spectrum = np.fft.rfft(square)
    spectrum[1:] *= closed
    tilt = np.fft.irfft(spectrum, samples) + 0.5
    shown = round(seconds / period_s)
    return np.arange(shown, dtype=np.float64) * period_s, np.asarray(tilt[:shown], np.float64)
