"""The signals of a run, an estimate or a step, by name: the same names as keys and as attributes, in either unit."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Iterator, Mapping
from typing import ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from plumb.near_names import did_you_mean
from plumb.spec.arrays import FloatArray
from plumb.spec.quaternion_angles import ANGLES
from plumb.spec.signal_units import IN_SI, word_signals

T_co = TypeVar("T_co", covariant=True)


_QUATERNION = ("attitude_w", "attitude_x", "attitude_y", "attitude_z")
_FRAMES = ("w", "x", "y", "z")
"""Their names in the frames of a link."""
_UNITS = {"deg": 180.0 / np.pi, "rad": 1.0}


class Named(Mapping[str, T_co]):
    """A mapping of signal -> value, whose keys are attributes, too.

    A name is a quantity with its unit at the end. Each signal has a name in the project's units (deg, deg/s, g, us) and
    one in SI (rad, rad/s, m/s^2, s): `tilt_deg` and `tilt_rad` are the same estimate. Both work as keys and as
    attributes; iteration lists the names of one of the two sets.

    What has an attitude has `attitude_w`, `attitude_x`, `attitude_y`, `attitude_z`, from the body to the earth or
    to the start, and from them `roll`, `pitch` and `yaw` (`roll_deg`, `roll_rad`, ...): turned by yaw about z, then by
    pitch about y, then by roll about x. At a pitch of +-90 deg roll and yaw are not determined.

    Raises KeyError, or AttributeError, with the nearest name for a signal that is not there.
    """

    SI: ClassVar[bool]
    """Whether iteration lists the names in SI."""

    def __getitem__(self, name: str) -> T_co:
        names = self._names()
        if name not in names:
            raise KeyError(f"{self._of()} has no signal '{name}'{did_you_mean(name, names)}")
        return self._given(self._value(name))

    def __getattr__(self, name: str) -> T_co:
        if name.startswith("_"):
            raise AttributeError(name)
        names = self._names()
        if name not in names:
            near = did_you_mean(name, [*names, *(own for own in super().__dir__() if not own.startswith("_"))])
            raise AttributeError(f"{type(self).__name__} of {self._of()} has no '{name}'{near}")
        return self._given(self._value(name))

    def __iter__(self) -> Iterator[str]:
        return iter(self._own(self.SI))

    def __len__(self) -> int:
        return len(self._own(self.SI))

    def __contains__(self, name: object) -> bool:
        return name in self._names()

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._names()})

    @property
    def quaternion(self) -> FloatArray:
        """Attitude w, x, y, z, (N, 4), or (4,) of one step. Raises AttributeError where there is none."""
        if not set(_QUATERNION) <= set(self._names()):
            raise AttributeError("quaternion")
        return np.stack([self._value(name) for name in _QUATERNION], axis=-1)

    def _names(self) -> list[str]:
        """Every name that is understood, those of iteration first."""
        names = dict.fromkeys([*self._own(self.SI), *self._own(not self.SI)])
        if set(_QUATERNION) <= names.keys():
            units = ("rad", "deg") if self.SI else ("deg", "rad")
            names |= dict.fromkeys(f"{angle}_{unit}" for unit in units for angle in ANGLES)
        return list(names)

    def _value(self, name: str) -> FloatArray:
        for si in (self.SI, not self.SI):
            if name in self._own(si):
                return self._measured(name, si)
        angle, _, unit = name.rpartition("_")
        w, x, y, z = (self._value(part) for part in _QUATERNION)
        return ANGLES[angle](w, x, y, z) * _UNITS[unit]

    @abstractmethod
    def _of(self) -> str:
        """The name of the system."""

    @abstractmethod
    def _own(self, si: bool) -> Collection[str]:
        """The names in one set of units."""

    @abstractmethod
    def _measured(self, name: str, si: bool) -> FloatArray:
        """The value of one of these names."""

    @abstractmethod
    def _given(self, value: FloatArray) -> T_co:
        """The value as this mapping gives it."""


class Signals(Named[T_co]):
    """The signals of a system's record of words."""

    def _own(self, si: bool) -> Collection[str]:
        return word_signals(self._of(), si=si)

    def _measured(self, name: str, si: bool) -> FloatArray:
        signal = word_signals(self._of(), si=si)[name]
        return np.asarray(self._word(signal.word) * signal.scale, np.float64)

    @abstractmethod
    def _word(self, name: str) -> npt.NDArray[np.int64]:
        """The integer word, (N,), or () of one step."""


class ArraySignals(Signals[FloatArray]):
    """Signals of N steps, (N,) each."""

    def _given(self, value: FloatArray) -> FloatArray:
        return value


class StepSignals(Signals[float]):
    """Signals of one step."""

    def _given(self, value: FloatArray) -> float:
        return float(value)


class Received(Named[T_co]):
    """Signals that a link or a log brought, by the names of its frames; those that did not come are not there.

    The frames call the attitude `w`, `x`, `y`, `z`; `attitude_w` and the others are the same here.
    """

    SI = False

    def __init__(self, system: str, values: Mapping[str, T_co]) -> None:
        self._system, self._values = system, values

    def __repr__(self) -> str:
        return repr(dict(self))

    def _of(self) -> str:
        return self._system

    def _own(self, si: bool) -> Collection[str]:
        return self._in_si() if si else self._values

    def _in_si(self) -> dict[str, tuple[str, float]]:
        """Name in SI -> name as it came, and what its value is multiplied by."""
        found = {name: (frame, 1.0) for name, frame in zip(_QUATERNION, _FRAMES, strict=True) if frame in self._values}
        for name in self._values:
            quantity, _, unit = name.rpartition("_")
            if unit in IN_SI:
                found[f"{quantity}_{IN_SI[unit][0]}"] = (name, IN_SI[unit][1])
        return found

    def _measured(self, name: str, si: bool) -> FloatArray:
        came, scale = self._in_si()[name] if si else (name, 1.0)
        return np.asarray(self._values[came], np.float64) * scale


class ReceivedArrays(Received[FloatArray]):
    """Received signals of N steps, (N,) each, NaN where a step did not come."""

    def _given(self, value: FloatArray) -> FloatArray:
        return value


class ReceivedStep(Received[float]):
    """Received signals of one step."""

    def _given(self, value: FloatArray) -> float:
        return float(value)
