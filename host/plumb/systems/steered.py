"""Contract of steered.py: a system whose vehicle a person steers in the browser (`plumb fly`).

The vehicle is a plant of which more is known: what the page draws, what may happen to it, and whether it is at rest.
The pilot's sticks do not come from it: they reach the board over the line of its radio receiver.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from plumb.physics.airframe import Airframe
from plumb.physics.imu import ImuGrade
from plumb.spec.system_parts import Part
from plumb.spec.tuning import AnyTuning
from plumb.systems.contracts import Plant

Point = tuple[float, float, float]


class Event(NamedTuple):
    """What a button of the page does to the vehicle. label: of the button; text: what happens; seconds: how long."""

    label: str
    text: str
    seconds: float


@dataclass(frozen=True)
class Shape:
    """A solid of the drawn vehicle, in body axes: x to the front, y to the left, z up.

    kind: `box` with its lengths along x, y, z; `cylinder` with radius and height along z; `propeller` with the radius
    of its disc and the width of a blade, of the motor with that number. turn_rad: about z, before it is moved to at_m.
    spin: 1 for a motor that turns counter-clockwise seen from above, -1 for the other way.
    """

    kind: str
    size_m: tuple[float, ...]
    at_m: Point
    colour: str
    turn_rad: float = 0.0
    motor: int = -1
    spin: float = 0.0


@dataclass(frozen=True)
class Drawing:
    """How the page draws a vehicle. motors: names, in the order of `Seen.motors`. hover: the throttle, 0 to 1, at which
    it neither rises nor sinks, for a page that holds the height; 0: it has no height to hold."""

    shapes: tuple[Shape, ...]
    motors: tuple[str, ...]
    hover: float


class Seen(NamedTuple):
    """The truth that the page draws: earth axes, z up; attitude from body to earth, w, x, y, z; motors: share of the
    full command of each."""

    position_m: Point
    velocity_mps: Point
    attitude: tuple[float, float, float, float]
    wind_mps: Point
    motors: tuple[float, ...]


class SteeredVehicle(Plant, Protocol):
    """A vehicle with its sensors, on the ground at its time 0."""

    def happen(self, event: str) -> None:
        """Let one of EVENTS begin now."""

    def happening(self) -> tuple[str, ...]:
        """The events that are on."""

    def seen(self) -> Seen:
        """What there is to be seen now."""

    def at_rest(self) -> bool:
        """Whether body and motors stand still."""


class Steered(Protocol):
    """steered.py of a system."""

    @property
    def TUNING(self) -> AnyTuning: ...

    @property
    def FRAMES(self) -> tuple[str, ...]:
        """Frames of the system that the page reads, besides the raw counts."""

    @property
    def ATTITUDE(self) -> tuple[str, str, str, str]:
        """Columns of these frames with the estimated attitude: w, x, y, z."""

    @property
    def SETTLED_S(self) -> float:
        """Time at rest after which the vehicle can be armed."""

    @property
    def IMU(self) -> ImuGrade: ...

    @property
    def AIRFRAME(self) -> Airframe: ...

    @property
    def EVENTS(self) -> Mapping[str, Event]: ...

    @property
    def DRAWING(self) -> Drawing: ...

    def said(self, newest: Mapping[str, float], /) -> str:
        """Who steers, as one phrase, from the newest value of each column."""

    def vehicle(self, seed: int, /, *, period_us: int) -> SteeredVehicle: ...


STEERED = Part[Steered]("steered", Steered, without="nobody steers it in the browser")
