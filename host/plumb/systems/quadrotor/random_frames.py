"""Frames drawn at random: any thrust to weight, size and motors that fly.

    thrust / weight    U(1.8, 12)
    mass               0.03 to 3 kg, its logarithm uniform
    inertia, arm       the hummingbird's, by mass to the power 5/3 and 1/3, each times U(0.7, 1.4)
    lag of the motors  U(10, 60) ms on the mean, falling twice as long as rising
    rotor drag         U(0.5, 2) times the estimator's setting, U(0.15, 0.6) 1/s

What else grows with the size grows with the cube root of the mass (legs, moment of a rotor, height of the drag), with
its square (area), or with the mass (springs and dampers of the legs); the speed of the rotors falls with it. All of
that is assumed. No gains fly a small frame with slow motors: the lag of a motor by its torque grows with its rotor, so
frames above LAG_MOST_S times the cube root of the mass by LAG_AT_KG are drawn again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from plumb.physics.airframe import G_MPS2, HUMMINGBIRD_X, Airframe, Point

THRUST_BY_WEIGHT, MASS_KG, SIZE, LAG_S = (1.8, 12.0), (0.03, 3.0), (0.7, 1.4), (0.01, 0.06)
DRAG_BY_SETTING, DRAG_SETTING_PER_S = (0.5, 2.0), (0.15, 0.6)
LAG_MOST_S, LAG_AT_KG = 0.05, 0.3


def flies(mass_kg: float, lag_s: float) -> bool:
    """Whether there are gains for motors with this lag on a frame of this mass."""
    return bool(lag_s <= LAG_MOST_S * (mass_kg / LAG_AT_KG) ** (1.0 / 3.0))


def drawn(rng: np.random.Generator) -> Airframe:
    while True:
        by_weight, lag_s = rng.uniform(*THRUST_BY_WEIGHT), rng.uniform(*LAG_S)
        mass_kg = float(np.exp(rng.uniform(*np.log(MASS_KG))))
        wide, heavy = rng.uniform(*SIZE, 2)
        setting_per_s, share = rng.uniform(*DRAG_SETTING_PER_S), rng.uniform(*DRAG_BY_SETTING)
        if flies(mass_kg, lag_s):
            return scaled(mass_kg, by_weight, float(wide), float(heavy), lag_s, setting_per_s, setting_per_s * share)


def scaled(
    mass_kg: float, by_weight: float, wide: float, heavy: float, lag_s: float, setting_per_s: float, drag_per_s: float
) -> Airframe:
    """A hummingbird of another size. by_weight: largest thrust by the weight; wide, heavy: factors of arm and inertia;
    drag_per_s: of its rotors."""
    known = HUMMINGBIRD_X
    size = (mass_kg / known.mass_kg) ** (1.0 / 3.0)
    speed_max = known.speed_max_radps / size
    thrust_ns2 = by_weight * mass_kg * G_MPS2 / 4.0 / speed_max**2
    front_right, front_left, rear_left, rear_right = (
        (x * size * wide, y * size * wide, z * size) for x, y, z in known.rotors_m
    )
    x, y, z = (value * size**5 * heavy for value in known.inertia_kgm2)
    inertia: Point = (x, y, z)
    frame = replace(
        known, mass_kg=mass_kg, inertia_kgm2=inertia, rotors_m=(front_right, front_left, rear_left, rear_right),
        thrust_ns2=thrust_ns2, moment_m=known.moment_m * size, speed_max_radps=speed_max,
        rolling_moment_kgm=known.rolling_moment_kgm * mass_kg / known.mass_kg * size,
        lag_up_s=lag_s * 2.0 / 3.0, lag_down_s=lag_s * 4.0 / 3.0, drag_area_m2=known.drag_area_m2 * size**2,
        drag_above_m=known.drag_above_m * size, drag_setting_per_s=setting_per_s, leg_out_m=known.leg_out_m * size,
        leg_down_m=known.leg_down_m * size, leg_spring_npm=known.leg_spring_npm * mass_kg / known.mass_kg,
        leg_damper_nspm=known.leg_damper_nspm * mass_kg / known.mass_kg,
    )  # fmt: skip
    return replace(frame, rotor_drag_kg=drag_per_s * mass_kg / (4.0 * frame.hover_radps))
