"""Run every shipped scenario of the systems with an actuator, and count the runs that the firmware's plausibility
checks would disarm. The C of firmware/core runs on the native core, in open and closed loop.

    tools/check_plausibility.py [--seeds 200] [--first-seed 2000] [--system NAME] [--only SCENARIO] [--seconds 30]

Exit code 0: none. 1: at least one.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from plumb import systems
from plumb.boards.native import core as native_core
from plumb.boards.native import plant as native_plant
from plumb.contract import disturbance
from plumb.contract.parameters import ControlParams, quantise
from plumb.contract.scenario import PushedSystem, tuning_for
from plumb.spec import declarations
from plumb.spec.records import Words
from plumb.spec.system import AXIS, RIDE

SYSTEMS = tuple(name for name, declared in declarations.systems().items() if declared.checks in (AXIS, RIDE))
"""Systems with an actuator; one that flies is never disarmed by such a check."""


@dataclass(frozen=True)
class Outcome:
    """Result of one run: the first step at which a check failed, and which; the first step at which the system was
    ready to be armed."""

    steps: int
    failed_step: int | None
    failed: int
    ready_step: int | None


def outcome(params: ControlParams, words: Words) -> Outcome:
    failed, missing = native_core.plausibility(params, words)
    bad, ready = np.flatnonzero(failed), np.flatnonzero(missing == 0)
    return Outcome(
        len(failed),
        int(bad[0]) if len(bad) else None,
        int(failed[bad[0]]) if len(bad) else 0,
        int(ready[0]) if len(ready) else None,
    )


def words_of(
    system: str, name: str, seed: int, params: ControlParams, loop: str, seconds: float | None = None
) -> Words:
    """The records of one run. loop: open, closed, or pushed (closed, with the push of the system's page)."""
    own = systems.load(system)
    faults: Sequence[object] = ()
    if loop == "pushed" and isinstance(own, PushedSystem):
        faults = own.faults([disturbance.parse(own.PUSHED[1])])
    period_us = round(params.period_s * 1e6)
    scenario = own.scenario(name, seed, seconds=seconds, period_us=period_us, faults=faults)
    if loop == "open":
        return native_core.run_control(params, scenario.counts(), scenario.setpoint())
    return native_plant.closed_loop(scenario, params).words


def cases(chosen: str | None, only: str | None) -> Iterator[tuple[str, str, str, str]]:
    """(system, scenario, tuning, loop): the scenario's tuning in all loops, the others in open loop."""
    for name in SYSTEMS if chosen is None else (chosen,):
        own = systems.load(name)
        for scenario in own.SCENARIOS if only is None else (only,):
            for tuning in own.TUNINGS:
                yield name, scenario, tuning, "open"
            yield name, scenario, tuning_for(own, scenario), "closed"
            if isinstance(own, PushedSystem) and scenario == own.PUSHED[0]:
                yield name, scenario, tuning_for(own, scenario), "pushed"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=2000)
    parser.add_argument("--system", choices=SYSTEMS)
    parser.add_argument("--only", metavar="SCENARIO")
    parser.add_argument("--seconds", type=float)
    asked = parser.parse_args()
    worst = 0
    print(
        f"{'system':<10}{'scenario':<10}{'tuning':<18}{'loop':<8}{'runs':>5}{'failed':>8}{'not ready':>11}"
        "  latest ready"
    )
    for system, scenario, tuning, loop in cases(asked.system, asked.only):
        own = systems.load(system)
        params = quantise(own.TUNINGS[tuning])
        found = []
        for seed in range(asked.first_seed, asked.first_seed + asked.seeds):
            found.append(outcome(params, words_of(system, scenario, seed, params, loop, asked.seconds)))
        failed = [row for row in found if row.failed_step is not None]
        ready = [row.ready_step for row in found if row.ready_step is not None]
        bits = 0
        for row in failed:
            bits |= row.failed
        print(
            f"{system:<10}{scenario:<10}{tuning:<18}{loop:<8}{len(found):>5}{len(failed):>8}"
            f"{len(found) - len(ready):>11}  {max(ready) * params.period_s if ready else float('nan'):.2f} s"
            + (f"  checks 0x{bits:X}, first at {failed[0].failed_step}" if failed else ""),
            flush=True,
        )
        worst += len(failed)
    return 1 if worst else 0


if __name__ == "__main__":
    sys.exit(main())
