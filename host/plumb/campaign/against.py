"""Compare two campaigns, paired by seed: whether the difference of a figure is real.

Runs of one seed share their noise, so that most of the spread cancels in their difference.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from plumb.campaign.results import Results
from plumb.errors import UsageError
from plumb.proof import intervals

NO_PAIRS = "the campaigns have no seed in common: run both with the same first seed"


@dataclass(frozen=True)
class Difference:
    """Difference of a metric: this campaign minus the other. low, high: 95 % interval of the mean difference; real: it
    does not have 0 in it."""

    metric: str
    pairs: int
    here: float
    other: float
    difference: float
    low: float
    high: float

    @property
    def real(self) -> bool:
        return self.low > 0.0 or self.high < 0.0

    def to_json(self) -> dict[str, object]:
        return {**asdict(self), "real": self.real}

    def __str__(self) -> str:
        said = "real: the interval does not have 0 in it" if self.real else "not shown: the interval has 0 in it"
        return (
            f"{self.metric}: {self.here:.4g} for {self.other:.4g}, difference {self.difference:+.4g} "
            f"({self.low:+.4g} to {self.high:+.4g}) over {self.pairs} pairs; {said}"
        )


def pairs(here: Results, other: Results) -> list[tuple[int, int]]:
    """Places of the runs that belong together: of the same seed, in the order in which the seed comes."""

    def keys(results: Results) -> dict[tuple[int, int], int]:
        seen: Counter[int] = Counter()
        found = {}
        for place, seed in enumerate(results.seed.tolist()):
            found[seed, seen[seed]] = place
            seen[seed] += 1
        return found

    mine, theirs = keys(here), keys(other)
    return [(place, theirs[key]) for key, place in mine.items() if key in theirs]


def check_seeds(seeds: range, other: Results) -> None:
    """Raises UsageError where a campaign with these seeds, before it is run, has none of the other's."""
    if not any(int(seed) in seeds for seed in other.seed):
        raise UsageError(NO_PAIRS)


def compare(here: Results, other: Results) -> list[Difference]:
    """Every metric that both have. Raises UsageError for campaigns without a common seed."""
    together = pairs(here, other)
    if not together:
        raise UsageError(NO_PAIRS)
    mine, theirs = (np.array(places) for places in zip(*together, strict=True))
    found = []
    for metric in here.metrics:
        if metric not in other.metrics:
            continue
        a, b = here.metrics[metric][mine], other.metrics[metric][theirs]
        known = np.isfinite(a) & np.isfinite(b)
        if not known.any():
            continue
        apart = (a - b)[known]
        low, high = intervals.of_mean(apart)
        found.append(
            Difference(
                metric, len(apart), float(a[known].mean()), float(b[known].mean()), float(apart.mean()), low, high
            )
        )
    return found


def texts(differences: Sequence[Difference]) -> list[str]:
    return [str(one) for one in differences]
