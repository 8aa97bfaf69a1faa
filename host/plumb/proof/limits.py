"""Accuracy limits of the systems' runs, and whether a run keeps them.

Bits and accuracy are two questions. The verdict of a run says whether every step equals the integer model: an estimate
far from the truth passes, too, when the model computes the same. A limit says how far from the truth is allowed. The
requirements of the sources are declared in the system's `figures.py`; the limits of all other scenarios and tunings are
measured and stand in its `limits.toml` (tools/gen_limits.py).
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from typing import Literal, cast

from plumb.proof.measures import Measure, main_of
from plumb.spec import declarations

FILE = "limits.toml"
SEEDS = range(1000, 1040)
"""Seeds of the measured limits. Tunings were fitted on seeds 0-19."""
MARGIN = 1.5
"""Factor of a measured limit over the worst of these seeds, because the errors of single runs scatter."""
BASIS = "1.5 times the worst of seeds 1000 to 1039"
ASKED_OF_MEAN = "asked of the mean of 40 seeds, a single run may miss it"
FLOWN, FLOWN_TABLES = "flown_rmse_deg", "flown"
"""Basis of the limits of a flown system: how far the vehicle is from what its pilot asks for, and the tables of its
limits."""
ANY_OTHER = "*"


@dataclass(frozen=True)
class Limit:
    """metric: the entry of a run's metrics that is limited. basis: where the value comes from. A limit that was asked
    of the mean of the seeds of `plumb systems --table` may be missed by a single seed."""

    metric: str
    sense: Literal["at most", "at least"]
    value: float
    unit: str
    basis: str = ASKED_OF_MEAN

    def kept_by(self, reached: float) -> bool:
        return reached <= self.value if self.sense == "at most" else reached >= self.value

    def as_text(self, reached: float, main: Measure | None) -> str:
        """The limit in words, with the figure unless it is the main one of the system, which the text already has."""
        limit = f"{self.sense} {self.value:g} {self.unit}"
        if main is not None and self.metric == main.metric:
            return limit + main.how
        return f"{self.metric} {reached:.4g} {self.unit}, {limit}"


Limits = Mapping[tuple[str, str, str], Sequence[Limit]]
"""(scenario, tuning, loop) -> limits; loop: open or closed."""


@cache
def _file(system: str) -> object:
    path = declarations.system(system).judging / FILE
    return tomllib.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}


def table(system: str, loop: str, scenario: str, *, shorter: bool = False) -> Mapping[str, float]:
    """Measured limits of a scenario by tuning, of the main figure of the system, and `*` for any other tuning; {}: none
    were measured. shorter: for runs of less than the scenario's length."""
    found = _file(system)
    for key in (*(["shorter"] if shorter else []), loop, scenario):
        found = found.get(key, {}) if isinstance(found, dict) else {}
    return cast(Mapping[str, float], found)


def measured(system: str, scenario: str, tuning: str, loop: str, *, shorter: bool = False) -> Sequence[Limit]:
    """The measured limits of a run; () where there are none."""
    found, main = [], main_of(system)
    for metric, unit, key in (
        *(((main.metric, main.unit, loop),) if main is not None else ()),
        (FLOWN, "deg", f"{FLOWN_TABLES}-{loop}"),
    ):
        limits = table(system, key, scenario, shorter=shorter)
        if (value := limits.get(tuning, limits.get(ANY_OTHER))) is not None:
            found.append(Limit(metric, "at most", value, unit, BASIS))
    return tuple(found)


@dataclass(frozen=True)
class Accuracy:
    """verdict: pass, fail, or None where there is no limit or no score. text: the same in words."""

    verdict: str | None
    limits: Sequence[Mapping[str, object]]
    text: str

    def to_json(self) -> dict[str, object]:
        return {"accuracy": self.verdict, "accuracy_limits": list(self.limits)}


def judged(
    metrics: Mapping[str, float | int | None],
    limits: Sequence[Limit],
    main: Measure | None,
    why_none: str = "",
    note: str = "",
) -> Accuracy:
    """Metrics of a run against limits. main: the main figure of the system. why_none: reason that there are no limits.
    note: a remark on the limits for the reader."""
    figure = None if main is None else metrics.get(main.metric)
    known = main is not None and figure is not None
    reached = f"{figure:.3g} {main.unit}{main.how}" if main and figure is not None else "no truth to compare with"
    scored = [(limit, value) for limit in limits if (value := metrics.get(limit.metric)) is not None]
    if not scored:
        return Accuracy(None, (), f"{reached} — {why_none or 'no limit is declared'}" if known else reached)
    rows = [{**asdict(limit), "reached": value, "kept": limit.kept_by(value)} for limit, value in scored]
    missed = [(limit, value) for limit, value in scored if not limit.kept_by(value)]
    named = "; ".join(limit.as_text(value, main) for limit, value in (missed or scored))
    bases = " and ".join(dict.fromkeys(limit.basis for limit, _ in (missed or scored)))
    text = f"{reached} — {'outside' if missed else 'within'} the limit: {named} ({bases}{note and '; '}{note})"
    return Accuracy("fail" if missed else "pass", rows, text)
