"""How many runs a second of one processor core: those of a campaign against those of `plumb.run`, one by one.

    python -m plumb.campaign.rate                 every system, open and closed loop, 60 s each
    python -m plumb.campaign.rate SYSTEM ...

Both are measured in this process, in turn, by its processor time, so that their ratio holds on a busy machine, too.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

from plumb import systems
from plumb.campaign.batch import run_batch
from plumb.campaign.study import Study
from plumb.proof import scenario_run

SECONDS = 60.0


@dataclass(frozen=True)
class Rate:
    """campaign_s, alone_s: processor time of a run."""

    system: str
    open_loop: bool
    campaign_s: float
    alone_s: float

    @property
    def ratio(self) -> float:
        return self.alone_s / self.campaign_s

    def __str__(self) -> str:
        loop = "open" if self.open_loop else "closed"
        return (
            f"{self.system:<12} {loop:<7} {1e3 * self.alone_s:9.1f} ms alone  {1e3 * self.campaign_s:7.2f} ms in a "
            f"campaign  {1.0 / self.campaign_s:7.1f} runs/s  {self.ratio:6.1f} times"
        )


def measure(
    system: str, *, open_loop: bool, seconds: float = SECONDS, rounds: int = 3, batch: int = 16, alone: int = 2
) -> Rate:
    """The best of some rounds of each, in turn."""
    study = Study(system, runs=rounds * batch, seconds=seconds, open_loop=open_loop)
    run_batch(study, range(1))  # modules and tables that the first run loads
    campaign_s = alone_s = float("inf")
    for number in range(rounds):
        begin_s = time.process_time()
        run_batch(study, range(number * batch, (number + 1) * batch))
        campaign_s = min(campaign_s, (time.process_time() - begin_s) / batch)
        begin_s = time.process_time()
        for index in range(alone):
            scenario_run.perform(study.request(number * batch + index)).run.metrics()
        alone_s = min(alone_s, (time.process_time() - begin_s) / alone)
    return Rate(system, open_loop, campaign_s, alone_s)


def main(names: list[str]) -> None:
    for name in names or list(systems.SYSTEMS):
        for open_loop in (True, False) if systems.load(name).OUTPUTS else (True,):
            print(measure(name, open_loop=open_loop), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
