"""The light of the page: green while every bit of every step equals the integer model on the same raw counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from plumb.contract.parameters import ControlParams
from plumb.errors import counted
from plumb.link.realtime import Capture
from plumb.proof.shadow import Shadow
from plumb.writers.record_report import Compared

Colour = Literal["green", "red", "amber", "off"]
ANEW = "; a new run is compared again"
FRESH_S = 0.5
"""The light goes out when no step was compared for this long."""


@dataclass(frozen=True)
class Light:
    """colour, and what it means, as one sentence."""

    colour: Colour
    text: str


VERDICTS: Mapping[Colour, Literal["pass", "fail", "unverified"]] = {
    "green": "pass", "red": "fail", "amber": "unverified",
}  # fmt: skip
"""What a light means for a run that has ended."""


class Comparison:
    """Compares one run with the model. Without params there is no model: `why_not` says why."""

    def __init__(self, params: ControlParams | None, why_not: str = "") -> None:
        self.shadow = Shadow(params, keeps=True) if params is not None else None
        self._why_not, self._compared_s = why_not, 0.0
        self.over = False
        """Whether the run has ended: what its steps were stays true."""

    def follow(self, capture: Capture, lost: int, now_s: float) -> None:
        """Compare the steps that are complete. lost: frames missing so far."""
        if self.shadow is None:
            return
        before = self.shadow.steps
        self.shadow.follow(capture, lost)
        if self.shadow.steps > before:
            self._compared_s = now_s

    @property
    def words(self) -> dict[int, Mapping[str, int]]:
        """The model's words of the steps that were equal, by step; whoever uses them removes them."""
        return {} if self.shadow is None else self.shadow.words

    @property
    def differs(self) -> bool:
        return self.shadow is not None and self.shadow.divergence is not None

    def ended(self) -> Compared | None:
        """The run has ended: the result for its report; None when no step was compared."""
        self.over = True
        return self.result()

    def result(self) -> Compared | None:
        """What the steps so far have shown; None when no step was compared."""
        light = self.light(self._compared_s)
        verdict = VERDICTS.get(light.colour)
        return None if verdict is None else Compared(verdict, light.text.removesuffix(ANEW))

    def light(self, now_s: float) -> Light:
        shadow = self.shadow
        if shadow is None:
            return Light("off", self._why_not)
        if shadow.divergence is not None:
            found = shadow.divergence
            return Light(
                "red", f"step {found.step} differs: digest {found.actual:08x}, of the model {found.expected:08x}"
            )
        if shadow.unverified_from is not None:
            where = f"unverified from step {shadow.unverified_from}: {shadow.unverified_why}"
            return Light("amber", f"{where}{ANEW}")
        if not shadow.steps:
            return Light("off", "no step has been compared yet")
        if self.over:
            return Light("green", f"all {_equal(shadow.steps)}")
        if now_s - self._compared_s > FRESH_S:
            return Light("off", f"{_equal(shadow.steps)}; no more come")
        return Light("green", _equal(shadow.steps))


def _equal(steps: int) -> str:
    return f"{counted(steps, 'step')} equal{'s' * (steps == 1)} the model in every bit"
