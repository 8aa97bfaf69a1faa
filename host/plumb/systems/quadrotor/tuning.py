"""The tuning of `quadrotor`, in engineering units. A command of 1 is all that the rotors have."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from plumb.spec.tuning import NUMBER, Esc, ForOnePeriod, quantity
from plumb.systems.attitude.tuning import AttitudeTuning


@dataclass(frozen=True)
class Level:
    """Mode level: the sticks ask for a lean."""

    lean_max_deg: float = field(default=35.0, metadata=quantity("deg", "lean that a full stick asks for"))
    gain_per_s: float = field(
        default=6.0, metadata=quantity("1/s", "rate that is asked for by the sine of the error of the vertical")
    )
    rate_max_dps: float = field(default=360.0, metadata=quantity("deg/s", "largest rate that the error asks for"))
    unsure_rate_max_dps: float = field(
        default=90.0, metadata=quantity("deg/s", "the same while the estimator is unsure of the vertical")
    )


@dataclass(frozen=True)
class RateGains:
    """The loop of one axis: commands by rates."""

    kp_per_dps: float = field(default=0.0, metadata=quantity("1/(deg/s)", "proportional gain: command by the error"))
    ki_per_deg: float = field(
        default=0.0, metadata=quantity("1/deg", "integral gain: command by the error and its time")
    )
    kd_per_dps2: float = field(
        default=0.0, metadata=quantity("1/(deg/s^2)", "derivative gain: command against the change of the rate")
    )
    ff_per_dps: float = field(
        default=0.0, metadata=quantity("1/(deg/s)", "feed-forward: command by the rate that is asked for")
    )


@dataclass(frozen=True, kw_only=True)
class Rates:
    """The loops of the three rates, and what full sticks ask for."""

    roll: RateGains = field(metadata=quantity(NUMBER, "roll"))
    pitch: RateGains = field(metadata=quantity(NUMBER, "pitch"))
    yaw: RateGains = field(metadata=quantity(NUMBER, "yaw"))
    roll_pitch_max_dps: float = field(
        default=400.0, metadata=quantity("deg/s", "rate of roll and pitch that a full stick asks for in mode rate")
    )
    yaw_max_dps: float = field(default=180.0, metadata=quantity("deg/s", "rate of yaw that a full stick asks for"))
    d_tau_s: float = field(
        default=0.0026, metadata=quantity("s", "time constant of the rate's low-pass in the D term; 0 is none")
    )
    integral_max: float = field(default=0.25, metadata=quantity(NUMBER, "largest integral part of a command"))


@dataclass(frozen=True)
class Mixer:
    """How four rotors share the commands."""

    idle: float = field(default=0.05, metadata=quantity(NUMBER, "least command of a rotor that is on"))
    yaw_max: float = field(default=0.15, metadata=quantity(NUMBER, "largest command of yaw"))
    airmode: int = field(
        default=1,
        metadata=quantity(NUMBER, "1: in the air roll and pitch may raise the thrust over the throttle; 0: never"),
    )
    low: float = field(default=0.05, metadata=quantity(NUMBER, "throttle below which the stick is low"))


@dataclass(frozen=True)
class Receiver:
    """What happens without the receiver: level and throttle, at most that of a hover, are held; then the rotors stop or
    the vehicle lands."""

    lost_s: float = field(default=0.1, metadata=quantity("s", "time without a new frame after which it is lost"))
    held_s: float = field(default=1.0, metadata=quantity("s", "time for which level and throttle are held"))
    back_s: float = field(
        default=1.0, metadata=quantity("s", "time of good frames after which a landing vehicle obeys again")
    )
    lands: int = field(default=0, metadata=quantity(NUMBER, "0: then the rotors stop; 1: the vehicle lands"))
    land_mps: float = field(default=1.0, metadata=quantity("m/s", "speed of descent of that landing"))
    land_s: float = field(default=60.0, metadata=quantity("s", "time after which the rotors of a landing stop"))


@dataclass(frozen=True)
class Stops:
    """What stops the rotors until they are switched off."""

    blind_s: float = field(default=0.05, metadata=quantity("s", "time without a sample"))
    idle_s: float = field(default=10.0, metadata=quantity("s", "time on the ground with the throttle low"))
    lying_s: float = field(
        default=1.0, metadata=quantity("s", "time at rest on its side or back with the throttle low")
    )
    runaway_s: float = field(
        default=0.04, metadata=quantity("s", "time at the take-off in which a rate grows against its limited command")
    )
    upturned_s: float = field(default=2.0, metadata=quantity("s", "time upside down although level is asked for"))


@dataclass(frozen=True, kw_only=True)
class QuadrotorTuning(ForOnePeriod):
    """The settings of a run of `quadrotor`. attitude: its own period is not used."""

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
