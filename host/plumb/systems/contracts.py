"""Contracts of the parts that a system may have in addition to its step and its runs (`plumb.contract`), as Protocols:
its plant on pins, poses in which it is held, checks of its sensors.

`plumb.systems.load` checks a module against its contract.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

from plumb.contract.scenario import Plant
from plumb.kernels.fixed.plausibility import Bounds
from plumb.spec.system_parts import Part

if TYPE_CHECKING:
    from plumb.f103.machine import Machine
    from plumb.physics.hand import Hand
    from plumb.tuning.pose_calibration import BodyTurn, Pose, Turn
    from plumb.tuning.vector_calibration import Sensor


class Conversion(NamedTuple):
    """A sample that the board took of the first raw channel. time_s: on the machine's clock; truth: true values
    then."""

    time_s: float
    raw_count: int
    truth: dict[str, float]


class Coupling(Protocol):
    """A plant joined to the pins of a simulated machine."""

    @property
    def taken(self) -> list[Conversion]:
        """The samples that the board took, in order of time."""


Couple = Callable[["Machine", Plant], Coupling]
"""Joins a plant to the pins of a machine; the plant's time 0 is the first sample of a step that the board takes."""


class Pins(Protocol):
    """pins.py: a system on the pins of the virtual board."""

    @property
    def couple(self) -> Couple: ...

    @property
    def FRAMES(self) -> tuple[str, ...]:
        """Frames that a live run selects: the raw counts that the system uses, and signals for a viewer."""

    @property
    def SCENARIO(self) -> str:
        """Default scenario of a served board's plant."""

    @property
    def SHOWN(self) -> str:
        """Default scenario for watching (monitor, record)."""

    @property
    def TUNING(self) -> str:
        """The tuning for the board's own sensors."""


class Held(NamedTuple):
    """A plant whose body a hand holds, and the hand."""

    plant: Plant
    hand: Hand


class Poses(Protocol):
    """poses.py: how a system is held to calibrate its sensors: TiltPoses or VectorPoses."""

    @property
    def POSES(self) -> tuple[Pose, ...]:
        """In the order in which they are asked for; a hand begins with the first one."""

    def held(self, seed: int, /) -> Held:
        """The plant for the pins, held by a hand, with the errors of its sensors drawn from the seed."""


@runtime_checkable
class TiltPoses(Protocol):
    """poses.py of a system that tilts about one axis, each sensor axis with parameters of its own. Every accelerometer
    group points up in one pose and down in another."""

    @property
    def POSES(self) -> tuple[Pose, ...]: ...

    @property
    def TURN(self) -> Turn: ...


@runtime_checkable
class VectorPoses(Protocol):
    """poses.py of a system with a three-axis gyro and accelerometer, each with one channel and a matrix. Every axis of
    the body points up in one pose and down in another; the turns lead about each of them, and back to where they
    began."""

    @property
    def POSES(self) -> tuple[Pose, ...]: ...

    @property
    def TURNS(self) -> tuple[BodyTurn, ...]: ...

    @property
    def PICTURE(self) -> str:
        """The axes of the body, drawn for a person before the first pose."""

    @property
    def GYRO(self) -> tuple[str, ...]:
        """Raw channels of the gyro, in the order of its axes."""

    @property
    def ACCEL(self) -> tuple[str, ...]:
        """Raw channels of the accelerometer, in the order of its axes."""

    def sensors_of(self, table: Mapping[str, int], /) -> tuple[Sensor, Sensor]:
        """Gyro and accelerometer of a table of parameters."""

    def words_of(self, gyro: Sensor, accel: Sensor, /) -> dict[str, int]:
        """Parameters of these sensors. Raises UsageError for what their integers cannot hold."""


@runtime_checkable
class AnalogPins(Protocol):
    """pins.py of a system whose sensors are analog; a system without ADC_PINS has digital ones on I2C."""

    @property
    def ADC_PINS(self) -> tuple[str, ...]:
        """The pins of its raw channels, in their order."""


@runtime_checkable
class SensorSets(Protocol):
    """pins.py of a system whose sensors come in several sets."""

    @property
    def SENSOR_SETS(self) -> tuple[str, ...]:
        """A scenario of each set, the default one first."""

    @property
    def SENSORS_ALIKE(self) -> Mapping[str, tuple[str, Mapping[str, int]]]:
        """Further sets that the tuning of one of these fits: that tuning, and what the board has to be told."""


@runtime_checkable
class CommandedPins(Protocol):
    """pins.py of a system whose outputs rest until its inputs are set."""

    @property
    def DRIVING(self) -> tuple[int, Mapping[str, int]]:
        """Setpoint and commands that take the outputs away from neutral."""


@runtime_checkable
class BridgePins(Protocol):
    """pins.py of a system that drives a bridge. Without BREAK_PIN a system drives speed controllers or nothing."""

    @property
    def BREAK_PIN(self) -> str:
        """Pin of the fault input; low means that the driver of the bridge reports a fault."""


@runtime_checkable
class BoundedSignals(Protocol):
    """fixed.py of a system whose sensors are checked for plausibility."""

    @property
    def PLAUSIBLE(self) -> Bounds:
        """What is plausible."""


PINS = Part[Pins]("pins", Pins, without="the board has no sensors of its own for it, its samples come as frames")


POSES = Part[Poses]("poses", Poses, without="no poses are declared in which its sensors could be calibrated")
