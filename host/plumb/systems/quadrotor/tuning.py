"""The tuning of `quadrotor`, in engineering units. A command of 1 is all that the rotors have."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import NUMBER, Esc, ForOnePeriod, quantity
from plumb.systems.attitude.tuning import AttitudeTuning
from plumb.systems.quadrotor.settings import Level, Mixer, Rates, Receiver, Stops


@dataclass(frozen=True, kw_only=True)
class QuadrotorTuning(ForOnePeriod):
    """The settings of a run of `quadrotor`; system.toml declares its own groups. attitude: its own period is not
    used."""

    system: ClassVar[str] = "quadrotor"

    period_us: int
    attitude: AttitudeTuning = field(metadata=quantity(NUMBER, "attitude"))
    rates: Rates = field(metadata=quantity(NUMBER, "rates"))
    level: Level = field(default_factory=Level)
    mixer: Mixer = field(default_factory=Mixer)
    receiver: Receiver = field(default_factory=Receiver)
    stops: Stops = field(default_factory=Stops)
    esc: Esc = field(default_factory=lambda: Esc(mid_us=1000.0, span_us=1000.0))
    exact_period_s: float | None = None
