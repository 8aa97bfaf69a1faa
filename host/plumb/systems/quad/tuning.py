"""The tuning of `quad`, in engineering units."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import AxisTuning, Esc, TiltMode


@dataclass(frozen=True, kw_only=True)
class QuadTuning(AxisTuning):
    """The settings of a run of `quad`."""

    system: ClassVar[str] = "quad"

    tilt: TiltMode = "arcsine"
    esc: Esc = field(default_factory=Esc)
