"""The setpoint of a system in its unit, and a test that steps it."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from plumb.cockpit.samples import Column, Samples
from plumb.cockpit.step_response import figures
from plumb.errors import UsageError
from plumb.link.session import Session
from plumb.spec.signal_units import setpoint_signal
from plumb.spec.signals import UNITS

MOST = {"deg": 30.0, "m/s": 1.0}
"""Largest setpoint that a page may give, by unit."""
SHORTEST_TEST_S, LONGEST_TEST_S = 0.5, 20.0
SMALLEST_STEP = 0.01
"""Part of the largest setpoint below which a step would drown in noise."""


@dataclass(frozen=True)
class Setpoint:
    """unit: deg or m/s; scale: units per LSB; most: largest value, to either side; follows: the signal that it is for,
    the first of the system's frames in this unit."""

    unit: str
    scale: float
    most: float
    follows: str

    @property
    def column(self) -> tuple[Column, float]:
        """For the rows of a run."""
        return Column(f"setpoint{UNITS[self.unit]}", self.unit), self.scale

    def raw(self, value: float) -> int:
        """The integer of a value; raises UsageError beyond the largest."""
        if not abs(value) <= self.most:
            raise UsageError(f"a setpoint of {value:g} {self.unit}: give one of at most {self.most:g} {self.unit}")
        return round(value / self.scale)


def setpoint_of(system: str) -> Setpoint | None:
    """The setpoint of a system that drives something; None for one without."""
    signal = setpoint_signal(system)
    if signal is None or signal.unit not in MOST:
        return None
    follows = next((name for name in _sent(system) if name.endswith(UNITS[signal.unit])), None)
    return None if follows is None else Setpoint(signal.unit, signal.scale, MOST[signal.unit], follows)


def _sent(system: str) -> list[str]:
    from plumb.spec.signals import signals

    return [name for _, name, _ in signals(system)]


class StepTest:
    """A step of the setpoint, back to 0 at its end. Raises UsageError for one that is too small, large, short or
    long."""

    def __init__(self, setpoint: Setpoint, size: float, seconds: float) -> None:
        if not SHORTEST_TEST_S <= seconds <= LONGEST_TEST_S:
            raise UsageError(f"a step test of {seconds:g} s: give {SHORTEST_TEST_S:g} to {LONGEST_TEST_S:g} s")
        if abs(size) < SMALLEST_STEP * setpoint.most:
            raise UsageError(f"a step of {size:g} {setpoint.unit} is too small to be seen")
        self._raw = setpoint.raw(size)
        self._setpoint, self._size, self._seconds = setpoint, size, seconds
        self._begin_s = self._before = 0.0

    @property
    def state(self) -> dict[str, object]:
        return {"begin_s": self._begin_s, "seconds": self._seconds, "size": self._size}

    def begin(self, session: Session, samples: Samples) -> None:
        """Step the setpoint; raises UsageError when the signal is where the step would bring it."""
        self._begin_s = samples.time_s
        _, recent = samples.series(self._setpoint.follows, self._begin_s - 0.5)
        self._before = sum(recent) / len(recent) if recent else 0.0
        if abs(self._size - self._before) < SMALLEST_STEP * self._setpoint.most:
            unit = self._setpoint.unit
            raise UsageError(f"a step to {self._size:g} {unit} is too small to be seen: {self._before:.3g} {unit} now")
        session.set_setpoint(self._raw)

    def follow(self, session: Session, samples: Samples, armed: bool) -> dict[str, object] | None:
        """The result, once the time is over or the board is not armed any more; None before."""
        if armed and samples.time_s < self._begin_s + self._seconds:
            return None
        if not armed:
            return {"text": "step test: the board was disarmed before its end"}
        session.set_setpoint(0)
        times, values = samples.series(self._setpoint.follows, self._begin_s)
        found = figures(times, values, self._begin_s, self._before, self._size - self._before)
        if found is None:
            return {"text": f"step test: {self._setpoint.follows} did not come"}
        unit = self._setpoint.unit
        rise = "not reached" if found.rise_s is None else f"{found.rise_s:.3f} s"
        settling = "not settled" if found.settling_s is None else f"{found.settling_s:.3f} s"
        text = (
            f"step test of {self._size:g} {unit}: rise time {rise}, overshoot {found.overshoot_percent:.0f} %, "
            f"settling time {settling}, final error {found.off:+z.3g} {unit}"
        )
        return {"text": text, "result": {**self.state, "unit": unit, **asdict(found)}}
