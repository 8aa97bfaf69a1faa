"""Confirmation of the figures on a board. The figures are computed with the native core; here every scenario and tuning
behind them also runs on a board, for one seed, and each step's digest is compared with that of the native core.

Every scenario runs with the tuning that it is made for, every tuning on the system's default scenario; the scenarios of
a system with outputs also run in closed loop.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from plumb import systems
from plumb.boards.contract import StepBoard
from plumb.boards.native.board import NativeBoard
from plumb.contract.parameters import quantise
from plumb.contract.scenario import fitted, tuning_for
from plumb.proof import runs
from plumb.proof.compare import count_mismatches

SEED = 1000


@dataclass(frozen=True)
class Confirmation:
    """One run, and the number of its steps that differ between the board and the native core."""

    system: str
    scenario: str
    tuning: str
    loop: str
    steps: int
    differ: int

    def __str__(self) -> str:
        run = f"{self.system} {self.scenario}, {self.tuning}, {self.loop} loop"
        return f"{run:<44} {self.differ} of {self.steps} steps differ"


def confirm(board: StepBoard, name: str, seed: int = SEED, seconds: float | None = None) -> Iterator[Confirmation]:
    """Run everything of a system, and yield each result when it is ready. seconds: limit for the length of each run;
    None: the scenario's own length."""
    system, native = systems.load(name), NativeBoard()
    own = {scenario: tuning_for(system, scenario) for scenario in system.SCENARIOS}
    default = system.DEFAULT_SCENARIO
    pairs = [(scenario, own[scenario], False) for scenario in system.SCENARIOS]
    pairs += [(default, tuning, False) for tuning in system.TUNINGS if tuning != own[default]]
    pairs += [(scenario, own[scenario], True) for scenario in system.SCENARIOS if system.OUTPUTS]
    for scenario, tuning, closed in pairs:
        length = system.SECONDS[scenario] if seconds is None else min(seconds, system.SECONDS[scenario])
        settings = system.TUNINGS[tuning]
        run = system.scenario(scenario, seed, seconds=length, period_us=settings.period_us)
        params = quantise(fitted(run, settings))
        if closed:
            digests, expected = (runs.closed_loop(one, run, params).answer.digests for one in (board, native))
        else:
            inputs = runs.prescribed(run)
            digests, expected = (
                one.run_injected(params, inputs.raw, inputs.setpoint).digests for one in (board, native)
            )
        differ = count_mismatches(expected, digests)
        yield Confirmation(name, scenario, tuning, "closed" if closed else "open", run.steps, differ)
