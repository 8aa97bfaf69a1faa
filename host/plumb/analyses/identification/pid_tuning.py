"""From a test of the loop to gains with margins, and the test again with them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumb.analyses.identification import chosen_settings, pid_design, plant_fit
from plumb.analyses.identification.loop_test import LoopRun, attitude_tuning
from plumb.analyses.identification.pid_design import Design, Wanted
from plumb.analyses.identification.plant_fit import PlantFit
from plumb.spec.arrays import FloatArray
from plumb.spec.tuning import AxisTuning, Pid
from plumb.systems.run_reference import run_control
from plumb.tuning.loop_model import Controller, Loop, Margins

GAINS = ("kp_per_deg", "ki_per_deg_s", "kd_per_dps", "derivative_tau_s")
FASTER = (2, 4)
"""Parts of the period at which gains are worked out, too."""
SHORTEST_US = 500


@dataclass(frozen=True)
class PidTuning:
    """The loop that was tested, its margins with the gains of now, and the gains that have the wanted ones. faster:
    period in us -> what gains for shorter steps would reach."""

    run: LoopRun
    tuning: AxisTuning
    r_deg2: float
    plant: PlantFit
    loop: Loop
    before: Margins
    wanted: Wanted
    design: Design
    faster: dict[int, Design]

    @property
    def tuned(self) -> AxisTuning:
        return replace(self.tuning, pid=self.design.pid)

    def settings(self) -> dict[str, float]:
        """The new gains by whole name."""
        return {f"pid.{name}": getattr(self.design.pid, name) for name in GAINS}

    def refusal(self) -> str:
        """Why the gains are not offered; "" if they are."""
        if not self.design.met:
            return "no gains reach the margins that are wanted at this period: ask for less, or take shorter steps"
        return chosen_settings.refusal(self.tuned)


def tune(run: LoopRun, wanted: Wanted, *, design: bool = True) -> PidTuning:
    """Identify the plant, work out its margins, and design gains; design: False keeps those of the run. Raises
    UsageError for a test that says too little."""
    tuning = attitude_tuning(run.params)
    plant = plant_fit.fit(run.measurement())
    r_deg2 = float(np.mean(run_control(tuning, run.raw, run.setpoint)["r_deg2"][run.begin :]))
    loop = Loop(plant.plant, Controller(tuning, r_deg2))
    before = loop.margins(tuning.pid)
    if not design:
        kept = Design(tuning.pid, before, pid_design.meets(before, wanted), 0.0)
        return PidTuning(run, tuning, r_deg2, plant, loop, before, wanted, kept, {})
    found = pid_design.design(loop, tuning.pid, wanted)
    faster = {}
    for part in FASTER:
        period_us = tuning.period_us // part
        if period_us >= SHORTEST_US:
            quick = replace(tuning, period_us=period_us, exact_period_s=None)
            shorter = Loop(plant.plant, Controller(quick, r_deg2))
            faster[period_us] = pid_design.design(shorter, found.pid, wanted)
    return PidTuning(run, tuning, r_deg2, plant, loop, before, wanted, found, faster)


def hold_rms_deg(run: LoopRun, seconds: float) -> float | None:
    """Rms of the true tilt in the last seconds before the test signal, while the setpoint is 0; None on a machine."""
    if not len(run.truth_deg):
        return None
    end = run.begin - len(run.excitation.setpoint_deg)
    return float(np.sqrt(np.mean(run.truth_deg[end - round(seconds / run.excitation.period_s) : end] ** 2)))


def step_response(loop: Loop, pid: Pid, seconds: float, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Tilt after a step of the setpoint by 1, at the samples, by the inverse transform of the closed loop: a step that
    goes up and down again, each after the loop has settled."""
    samples = 2 * max(64, round(8.0 * seconds / period_s))
    hz: FloatArray = np.asarray(np.fft.rfftfreq(samples, period_s)[1:], np.float64)
    closed = loop.closed(hz, pid)
    square = np.where(np.arange(samples) < samples // 2, 0.5, -0.5)
    spectrum = np.fft.rfft(square)
    spectrum[1:] *= closed
    tilt = np.fft.irfft(spectrum, samples) + 0.5
    shown = round(seconds / period_s)
    return np.arange(shown, dtype=np.float64) * period_s, np.asarray(tilt[:shown], np.float64)
