"""Quadrotors by their numbers.

    hummingbird   RotorS (ETH Zurich), rotors_description/urdf/hummingbird.xacro: body 0.68 kg and four rotors of 9 g
    iris          PX4, PX4-SITL_gazebo-classic models/iris/iris.sdf.jinja: body 1.5 kg, sensor 15 g, four rotors of 5 g
    racer         a drone with propellers of 5 inches and eight times its weight of thrust: assumed

Assumed for all: drag of the frame (CdA, and how far above the centre it acts), legs (which give way by 3 mm under 0.7
kg), and the thrust for a command.
Axes of the body: x to the front, y to the left, z up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plumb.spec.arrays import FloatArray

G_MPS2 = 9.80665
AIR_KGPM3 = 1.2
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Airframe:
    """rotors_m: where they are; spin: +1 of a rotor that turns counter-clockwise seen from above, else -1. A rotor at w
    rad/s pushes up with thrust * w^2, is turned back with moment_m times that, drags by rotor_drag * w * speed across
    its axis, and rolls by rolling_moment * w * speed about the direction of that speed. drag_setting_per_s: the
    value for an estimator that uses the drag; more than drag_per_s, because the frame has drag, too."""

    mass_kg: float
    inertia_kgm2: Point
    rotors_m: tuple[Point, Point, Point, Point]
    spin: tuple[float, float, float, float]
    thrust_ns2: float
    moment_m: float
    speed_max_radps: float
    rotor_drag_kg: float
    rolling_moment_kgm: float
    lag_up_s: float = 0.0125
    lag_down_s: float = 0.025
    drag_area_m2: float = 0.012
    drag_above_m: float = 0.03
    drag_setting_per_s: float = 0.0
    leg_out_m: float = 0.12
    leg_down_m: float = 0.08
    leg_spring_npm: float = 600.0
    leg_damper_nspm: float = 8.0

    @property
    def weight_n(self) -> float:
        return self.mass_kg * G_MPS2

    @property
    def thrust_max_n(self) -> float:
        """Largest thrust of all four rotors together, with a full battery."""
        return 4.0 * self.thrust_ns2 * self.speed_max_radps**2

    @property
    def hover_radps(self) -> float:
        """Speed of each rotor in a hover."""
        return float(np.sqrt(self.weight_n / (4.0 * self.thrust_ns2)))

    @property
    def hover_command(self) -> float:
        """Command of each rotor in a hover with a full battery, 0 to 1."""
        return float(command_for(np.array(self.weight_n / self.thrust_max_n)))

    @property
    def drag_per_s(self) -> float:
        """Rotor drag by mass in a hover, 1/s: a slow horizontal speed decays with it."""
        return 4.0 * self.rotor_drag_kg * self.hover_radps / self.mass_kg

    def turned(self, angle_rad: float) -> Airframe:
        """The same frame with the axes of the body turned about z by -angle, so that its rotors turn by +angle. Only
        for frames whose inertias about x and y are equal."""
        assert self.inertia_kgm2[0] == self.inertia_kgm2[1], "its axes of inertia would not be the body's"
        sine, cosine = np.sin(angle_rad), np.cos(angle_rad)
        first, second, third, fourth = (
            (float(x * cosine - y * sine), float(x * sine + y * cosine), z) for x, y, z in self.rotors_m
        )
        return replace(self, rotors_m=(first, second, third, fourth))

    def allocation(self) -> FloatArray:
        """Thrusts of the rotors in N to total thrust in N and torque about x, y, z in N m, (4, 4)."""
        x, y, _ = np.array(self.rotors_m).T
        # The air turns a rotor back, so the body turns against the rotor's spin.
        return np.stack([np.ones(4), y, -x, -self.moment_m * np.array(self.spin)])


HUMMINGBIRD = Airframe(
    mass_kg=0.68 + 4 * 0.009,
    inertia_kgm2=(0.007, 0.007, 0.012),
    rotors_m=((0.17, 0.0, 0.01), (0.0, 0.17, 0.01), (-0.17, 0.0, 0.01), (0.0, -0.17, 0.01)),
    spin=(-1.0, 1.0, -1.0, 1.0),
    thrust_ns2=8.54858e-6,
    moment_m=0.016,
    speed_max_radps=838.0,
    rotor_drag_kg=8.06428e-5,
    rolling_moment_kgm=1e-6,
    drag_setting_per_s=0.28,
)
IRIS = Airframe(
    mass_kg=1.5 + 0.015 + 4 * 0.005,
    inertia_kgm2=(0.029125, 0.029125, 0.055225),
    rotors_m=((0.13, -0.22, 0.023), (-0.13, 0.2, 0.023), (0.13, 0.22, 0.023), (-0.13, -0.2, 0.023)),
    spin=(1.0, 1.0, -1.0, -1.0),
    thrust_ns2=5.84e-6,
    moment_m=0.06,
    speed_max_radps=1100.0,
    rotor_drag_kg=1.75e-4,
    rolling_moment_kgm=1e-6,
    drag_setting_per_s=0.5,
    leg_out_m=0.15,
    leg_down_m=0.1,
)
RACER_X = Airframe(
    mass_kg=0.65,
    inertia_kgm2=(0.0025, 0.0025, 0.0045),
    rotors_m=((0.078, -0.078, 0.02), (0.078, 0.078, 0.02), (-0.078, 0.078, 0.02), (-0.078, -0.078, 0.02)),
    spin=(-1.0, 1.0, -1.0, 1.0),
    thrust_ns2=1.86e-6,
    moment_m=0.012,
    speed_max_radps=2618.0,
    rotor_drag_kg=4.5e-5,
    rolling_moment_kgm=1e-6,
    lag_up_s=0.02,
    lag_down_s=0.04,
    drag_area_m2=0.01,
    drag_above_m=0.015,
    drag_setting_per_s=0.3,
    leg_out_m=0.06,
    leg_down_m=0.03,
)
"""A racer with propellers of 5 inches, flown as an X. Every number is assumed: 8 times its weight of thrust at 25,000
turns a minute, 220 mm from motor to motor across."""
HUMMINGBIRD_X = HUMMINGBIRD.turned(-np.pi / 4.0)
"""The hummingbird flown as an X: its rotors front right, front left, rear left, rear right."""
IRIS_X = replace(
    IRIS, rotors_m=(IRIS.rotors_m[0], IRIS.rotors_m[2], IRIS.rotors_m[1], IRIS.rotors_m[3]), spin=HUMMINGBIRD.spin
)
"""The iris with its rotors in the same order. Assumed: its motors turn the other way round than the iris', as the
hummingbird's do."""
AIRFRAMES = {"hummingbird": HUMMINGBIRD, "iris": IRIS, "racer": RACER_X}

THRUST_SQUARE, THRUST_LINEAR = 0.6, 0.4
"""Share of the largest thrust that a command u of 0 to 1 makes: 0.6 u^2 + 0.4 u (assumed; a battery at rest)."""


def thrust_share(command: FloatArray) -> FloatArray:
    return (THRUST_SQUARE * command + THRUST_LINEAR) * command


def command_for(share: FloatArray) -> FloatArray:
    """The command, 0 to 1, that makes a share of the largest thrust."""
    limited = np.clip(share, 0.0, 1.0)
    root = np.sqrt(THRUST_LINEAR**2 + 4.0 * THRUST_SQUARE * limited)
    return np.minimum((root - THRUST_LINEAR) / (2.0 * THRUST_SQUARE), 1.0)
