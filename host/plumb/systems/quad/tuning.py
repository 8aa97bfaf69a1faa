"""The tuning of `quad`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import CHOICE, TILT_MEANING, AxisTuning, Esc, TiltMode, quantity


@dataclass(frozen=True, kw_only=True)
class QuadTuning(AxisTuning):
    """The settings of a run of `quad`."""

    system: ClassVar[str] = "quad"

    tilt: TiltMode = field(default="arcsine", metadata=quantity(CHOICE, TILT_MEANING))
    esc: Esc = field(default_factory=Esc)
