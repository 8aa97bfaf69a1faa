"""The signals of a run, an estimate or a step, by name: the same names as keys and as attributes, in either unit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np

from plumb.near_names import did_you_mean
from plumb.spec.arrays import FloatArray
from plumb.spec.signal_units import word_signals

T_co = TypeVar("T_co", covariant=True)


def _roll(w: Any, x: Any, y: Any, z: Any) -> Any:
    return np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))


def _pitch(w: Any, x: Any, y: Any, z: Any) -> Any:
    return np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))


def _yaw(w: Any, x: Any, y: Any, z: Any) -> Any:
    return np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


_QUATERNION = ("attitude_w", "attitude_x", "attitude_y", "attitude_z")
_ANGLES: dict[str, Callable[..., Any]] = {"roll": _roll, "pitch": _pitch, "yaw": _yaw}
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
    system: Any  # Any: a property here, a field there
    words: Any

    def __getitem__(self, name: str) -> T_co:
        if name not in self._names():
            raise KeyError(f"{self.system} has no signal '{name}'{did_you_mean(name, self._names())}")
        return self._value(name)

    def __getattr__(self, name: str) -> T_co:
        if name.startswith("_"):
            raise AttributeError(name)
        names = self._names()
        if name not in names:
            near = did_you_mean(name, [*names, *(own for own in super().__dir__() if not own.startswith("_"))])
            raise AttributeError(f"{type(self).__name__} of {self.system} has no '{name}'{near}")
        return self._value(name)

    def __iter__(self) -> Iterator[str]:
        return iter(word_signals(self.system, si=self.SI))

    def __len__(self) -> int:
        return len(word_signals(self.system, si=self.SI))

    def __contains__(self, name: object) -> bool:
        return name in self._names()

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *self._names()})

    @property
    def quaternion(self) -> FloatArray:
        """Attitude w, x, y, z, (N, 4), or (4,) of one step. Raises AttributeError for a system that has none."""
        return np.stack([np.asarray(getattr(self, name), np.float64) for name in _QUATERNION], axis=-1)

    def _names(self) -> list[str]:
        """Every name that is understood, those of iteration first."""
        names = dict.fromkeys([*word_signals(self.system, si=self.SI), *word_signals(self.system, si=not self.SI)])
        if set(_QUATERNION) <= names.keys():
            units = ("rad", "deg") if self.SI else ("deg", "rad")
            names |= dict.fromkeys(f"{angle}_{unit}" for unit in units for angle in _ANGLES)
        return list(names)

    def _value(self, name: str) -> T_co:
        for si in (self.SI, not self.SI):
            signal = word_signals(self.system, si=si).get(name)
            if signal is not None:
                return self._scaled(self.words[signal.word] * signal.scale)
        angle, _, unit = name.rpartition("_")
        parts = (self._value(part) for part in _QUATERNION)
        return self._scaled(_ANGLES[angle](*parts) * _UNITS[unit])

    def _scaled(self, value: Any) -> T_co:
        """The value as this mapping gives it."""
        raise NotImplementedError


class ArraySignals(Signals[FloatArray]):
    """Signals of N steps, (N,) each."""

    def _scaled(self, value: Any) -> FloatArray:
        return np.asarray(value, np.float64)


class StepSignals(Signals[float]):
    """Signals of one step."""

    def _scaled(self, value: Any) -> float:
        return float(value)
