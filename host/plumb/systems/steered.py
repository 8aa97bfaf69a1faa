"""Contract of fly.py and ride.py: a system whose vehicle a person steers in the browser (`plumb fly`, `plumb ride`).

The vehicle is a plant of which more is known: what the page draws, what may happen to it, and whether it is at rest.
The sticks do not come from it: they reach the board over the line of its radio receiver. A trip is one flight or ride.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from plumb import systems
from plumb.contract.scenario import Plant
from plumb.errors import UsageError
from plumb.physics.imu import ImuGrade
from plumb.spec.arrays import FloatArray
from plumb.spec.system_parts import Part
from plumb.spec.tuning import AnyTuning

Point = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


class Event(NamedTuple):
    """Effect of a button of the page on the vehicle. label: of the button; text: what happens; seconds: how long, 0:
    until the button is pressed again."""

    label: str
    text: str
    seconds: float


@dataclass(frozen=True)
class Shape:
    """A solid of the drawn vehicle, in body axes: x to the front, y to the left, z up.

    kind: `box` with its lengths along x, y, z; `cylinder` with radius and height along z; `wheel` with radius and width
    along y; `propeller` with the radius of its disc and the width of a blade. turn_rad: about z, before it is moved to
    at_m. motor: number of the motor that turns it, -1: none does; a propeller turns about z by the motor's share, all
    else about y by its angle in `Seen.turned_rad`. spin: of a propeller, 1 counter-clockwise seen from above, -1 the
    other way. without: the event during which it is not there; during: the one during which alone it is,
    and then it turns with the heading alone, as what is on the ground.
    """

    kind: str
    size_m: tuple[float, ...]
    at_m: Point
    colour: str
    turn_rad: float = 0.0
    motor: int = -1
    spin: float = 0.0
    without: str = ""
    during: str = ""


class Reading(NamedTuple):
    """A number that the page shows. label: one word."""

    label: str
    unit: str


@dataclass(frozen=True)
class Drawing:
    """How the page draws a vehicle. motors: names, in the order of `Seen.motors`; readings: those of `Seen.readings`;
    estimate: what the ghost of the estimate shows, and what not; away_m: distance of the camera behind it."""

    shapes: tuple[Shape, ...]
    motors: tuple[str, ...]
    readings: tuple[Reading, ...]
    estimate: str
    away_m: float


@dataclass(frozen=True)
class Controls:
    """Controls of the vehicle, and the page's words for them.

    trip: `flight` or `ride`; motors: what the switch turns on; first: what to do once it is on. hover: the throttle, 0
    to 1, at which it neither rises nor sinks, for a page that holds the height; None: it has no throttle, and both
    sticks drive and turn it. modes: of the mode switch, off and on; (): the key of the mode lets `event` happen.
    """

    trip: str
    motors: str
    first: str
    hover: float | None = None
    modes: tuple[str, ...] = ()
    event: str = ""


class Seen(NamedTuple):
    """The truth that the page draws: earth axes, z up; attitude from body to earth, w, x, y, z; wind_mps: None for a
    vehicle that feels none; motors: share of the full command of each, -1 to 1; turned_rad: angle of what each motor
    turns, against the body, () where it is not known; readings: as `Drawing.readings`."""

    position_m: Point
    velocity_mps: Point
    attitude: Quaternion
    wind_mps: Point | None
    motors: tuple[float, ...]
    turned_rad: tuple[float, ...]
    readings: tuple[float, ...]


class SteeredVehicle(Plant, Protocol):
    """A vehicle with its sensors, on the ground at its time 0."""

    def happen(self, event: str) -> None:
        """Let one of EVENTS begin now, or end one that is on until it is asked for again."""

    def happening(self) -> tuple[str, ...]:
        """The events that are on."""

    def seen(self) -> Seen:
        """The present positions for the drawing."""

    def at_rest(self) -> bool:
        """Whether it may be left where it is: it stands."""

    def sample_of(self, taken: Sequence[int]) -> Sequence[int] | None:
        """Counts of gyro and accelerometer, x, y, z each, in the sample of which the board took these raw counts; None
        where there is no such sample."""


class Estimate(Protocol):
    """The attitude that the board estimates, from the columns that it sends."""

    def follow(self, values: FloatArray) -> Quaternion | None:
        """The attitude after these steps, None before the first. values: (steps, columns) of ESTIMATED, NaN where a
        frame did not arrive."""


class Steered(Protocol):
    """fly.py or ride.py of a system."""

    @property
    def TUNING(self) -> AnyTuning: ...

    @property
    def FRAMES(self) -> tuple[str, ...]:
        """Frames of the system that the page reads, in addition to the raw counts."""

    @property
    def ESTIMATED(self) -> tuple[str, ...]:
        """Columns of these frames that `Estimate` takes."""

    @property
    def SETTLED_S(self) -> float:
        """Time at rest after which the vehicle can be armed."""

    @property
    def IMU(self) -> ImuGrade: ...

    @property
    def EVENTS(self) -> Mapping[str, Event]: ...

    @property
    def DRAWING(self) -> Drawing: ...

    @property
    def CONTROLS(self) -> Controls: ...

    def said(self, newest: Mapping[str, float], receiving: bool, /) -> str:
        """The mode as one phrase, from the newest value of each column. receiving: whether the receiver gets frames."""

    def estimate(self, period_s: float, /) -> Estimate:
        """The estimate before the first step. period_s: of the steps."""

    def vehicle(self, seed: int, /, *, period_us: int) -> SteeredVehicle: ...


FLY = Part[Steered]("fly", Steered, without="nobody flies it in the browser")
RIDE = Part[Steered]("ride", Steered, without="nobody rides it in the browser")
PARTS = (FLY, RIDE)
"""By the name of the command."""


def part_of(system: str) -> Part[Steered]:
    """The part of a system that a person steers; its name is the command's. Raises UsageError for another system."""
    for part in PARTS:
        if system in systems.with_part(part.name):
            return part
    raise UsageError(f"{system} has neither fly.py nor ride.py: nobody steers it in the browser")


def steered(system: str) -> Steered:
    """The vehicle of a system that a person steers. Raises UsageError for another system."""
    return systems.load(system, part_of(system))
