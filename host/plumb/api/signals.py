"""The signals of a run, an estimate or a step, by name: the same names as keys and as attributes, in either unit."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from typing import ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from plumb.near_names import did_you_mean
from plumb.spec.arrays import FloatArray
from plumb.spec.signal_units import word_signals

T_co = TypeVar("T_co", covariant=True)


def _roll(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    return np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))


def _pitch(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    return np.asarray(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)), np.float64)


def _yaw(w: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


_QUATERNION = ("attitude_w", "attitude_x", "attitude_y", "attitude_z")
_ANGLES: dict[str, Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray]] = {
    "roll": _roll,
    "pitch": _pitch,
    "yaw": _yaw,
}
_UNITS = {"deg": 180.0 / np.pi, "rad": 1.0}


class Signals(Mapping[str, T_co]):
    """A mapping of signal -> value.

    A name is a quantity with its unit at the end. Each signal has a name in the project's units (deg, deg/s, g, us) and
    one in SI (rad, rad/s, m/s^2, s): `tilt_deg` and `tilt_rad` are the same estimate. Both work as keys and as
    attributes; iteration lists the names of one of the two sets.

    A system with an attitude has `attitude_w`, `attitude_x`, `attitude_y`, `attitude_z`, from the body to the earth or
    to the start, and from them `roll`, `pitch` and `yaw` (`roll_deg`, `roll_rad`, ...): turned by yaw about z, then by
    pitch about y, then by roll about x. At a pitch of +-90 deg roll and yaw are not determined.

    Raises KeyError, or AttributeError, with the nearest name for a signal that the system does not have.
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
        return iter(word_signals(self._of(), si=self.SI))

    def __len__(self) -> int:
        return len(word_signals(self._of(), si=self.SI))

    def __contains__(self, name: object) -> bool:
        return name in self._names()

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._names()})

    @property
    def quaternion(self) -> FloatArray:
        """Attitude w, x, y, z, (N, 4), or (4,) of one step. Raises AttributeError for a system that has none."""
        if not set(_QUATERNION) <= set(self._names()):
            raise AttributeError("quaternion")
        return np.stack([self._value(name) for name in _QUATERNION], axis=-1)

    def _names(self) -> list[str]:
        """Every name that is understood, those of iteration first."""
        own, other = (word_signals(self._of(), si=si) for si in (self.SI, not self.SI))
        names = dict.fromkeys([*own, *other])
        if set(_QUATERNION) <= names.keys():
            units = ("rad", "deg") if self.SI else ("deg", "rad")
            names |= dict.fromkeys(f"{angle}_{unit}" for unit in units for angle in _ANGLES)
        return list(names)

    def _value(self, name: str) -> FloatArray:
        for si in (self.SI, not self.SI):
            signal = word_signals(self._of(), si=si).get(name)
            if signal is not None:
                return np.asarray(self._word(signal.word) * signal.scale, np.float64)
        angle, _, unit = name.rpartition("_")
        w, x, y, z = (self._value(part) for part in _QUATERNION)
        return _ANGLES[angle](w, x, y, z) * _UNITS[unit]

    @abstractmethod
    def _of(self) -> str:
        """The name of the system."""

    @abstractmethod
    def _word(self, name: str) -> npt.NDArray[np.int64]:
        """The integer word, (N,), or () of one step."""

    @abstractmethod
    def _given(self, value: FloatArray) -> T_co:
        """The value as this mapping gives it."""


class ArraySignals(Signals[FloatArray]):
    """Signals of N steps, (N,) each."""

    def _given(self, value: FloatArray) -> FloatArray:
        return value


class StepSignals(Signals[float]):
    """Signals of one step."""

    def _given(self, value: FloatArray) -> float:
        return float(value)
