"""Accuracy limits that a system declares, and whether a run keeps them.

Bits and accuracy are two questions. The verdict of a run says whether every step equals the integer model; an estimate
far from the truth passes, too, when the model makes the same. A limit says how far from the truth is allowed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Literal


@dataclass(frozen=True)
class Limit:
    """metric: the entry of a run's metrics that is limited. The limit was asked of the mean of the seeds that
    `plumb systems --table` takes; a single seed may miss it."""

    metric: str
    sense: Literal["at most", "at least"]
    value: float
    unit: str

    def kept_by(self, reached: float) -> bool:
        return reached <= self.value if self.sense == "at most" else reached >= self.value

    def beside(self, reached: float) -> str:
        """The figure and its limit in words."""
        return f"{self.metric} {reached:.4g} {self.unit}, limit {self.sense} {self.value:g} {self.unit}"


Limits = Mapping[tuple[str, str, str], Sequence[Limit]]
"""(scenario, tuning, loop) -> limits; loop: open or closed."""


@dataclass(frozen=True)
class Accuracy:
    """verdict: pass, fail, or None where no limit was asked or nothing is to be scored. text: the same in words."""

    verdict: str | None
    limits: Sequence[Mapping[str, object]]
    text: str

    def to_json(self) -> dict[str, object]:
        return {"accuracy": self.verdict, "accuracy_limits": list(self.limits)}


def judged(metrics: Mapping[str, float | int | None], limits: Sequence[Limit], why_none: str = "") -> Accuracy:
    """Metrics of a run against limits. why_none: reason that there are none, instead of "no limit was asked"."""
    rms = metrics.get("angle_rmse_deg")
    reached = "no truth to compare with" if rms is None else f"{rms:.3g} deg rms"
    scored = [(limit, value) for limit in limits if (value := metrics.get(limit.metric)) is not None]
    if not scored:
        return Accuracy(None, (), f"{reached} — {why_none or 'no limit was asked'}")
    rows = [{**asdict(limit), "reached": value, "kept": limit.kept_by(value)} for limit, value in scored]
    missed = [(limit, value) for limit, value in scored if not limit.kept_by(value)]
    where = "outside" if missed else "within"
    named = "; ".join(limit.beside(value) for limit, value in (missed or scored))
    text = f"{reached} — {where} the declared limit ({named}; asked of the mean of 40 seeds)"
    return Accuracy("fail" if missed else "pass", rows, text)
