"""A vehicle that must not be armed by its pilot's switch, because it leans or falls, and one that loses its receiver in
the air. The sensors say where it is: the plant stands on its stand."""

from __future__ import annotations

import math
from collections.abc import Callable

from plumb.f103.attached.invensense import Invensense
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.pilot import PILOT
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import RECEIVER, Scene, noise

FLOWN = frozenset({PILOT})
Axes = tuple[float, float, float]
MOVING, LEANING = (Told("PLAUSIBILITY", "missing", 1 << bit) for bit in (1, 4))
BY_STEP = Told("EVENTS", "disarm_cause", 1 << 15)
RECEIVER_LOST = Told("PLAUSIBILITY", "disarmed_by", 1 << 11)
ARMED = Told("STATUS", "armed", value=1)
SENSOR = "gyro"
"""Of the coupling: one chip with both sensors."""
GYRO_DPS, ACCEL_G = 0.05, 0.005
"""Noise of the sensors, rms."""
LEANS_S, LIES_S = 0.6, 1.4
"""Time in which the vehicle is leant, and in which it then lies still: the vertical is known again."""
LEANINGS = tuple((angle, axis, sign) for angle, axis in ((30.0, 0), (60.0, 1)) for sign in (1.0, -1.0))
"""Angle in deg, axis and direction of the slope that it stands on, by variant."""
FALLS_S = 0.5
FELT_G = (0.0, 0.3, 0.6, 0.85)
"""Of a vehicle that falls, by variant: at its terminal speed it would feel its weight."""
CLIMB_G = 1.3
"""Of one that climbs."""
CLIMBS_S = 1.5
TRIES_S = 0.2
"""The switch is on for so long before the throttle is raised."""
AWAY_S = 0.9
"""Without the receiver, in the air: less than it is held for."""


def feels(scene: Scene, rates_dps: Callable[[float], Axes], forces_g: Callable[[float], Axes]) -> None:
    """What the chip measures from now on, by the time since now, with noise."""
    chip, begin_s = getattr(scene.coupling, SENSOR), scene.machine.now_s
    assert isinstance(chip, Invensense)
    added = [noise(f"felt {axis}", 1.0) for axis in range(6)]

    def source(value: Callable[[float], Axes], sigma: float, first: int) -> Callable[[float], Axes]:
        def measured(time_s: float) -> Axes:
            x, y, z = (at + sigma * added[first + axis](time_s) for axis, at in enumerate(value(time_s - begin_s)))
            return x, y, z

        return measured

    chip.source, chip.forces = source(rates_dps, GYRO_DPS, 0), source(forces_g, ACCEL_G, 3)


def weight(share_g: float) -> Action:
    """Level and without turning, it feels so much."""
    return lambda scene: feels(scene, lambda _s: (0.0, 0.0, 0.0), lambda _s: (0.0, 0.0, share_g))


def switched_off(scene: Scene) -> None:
    assert scene.pilot is not None
    scene.pilot.says = (0.0, False)
    scene.run(0.1)


def leans(scene: Scene) -> None:
    """Switched off, it is leant over about an axis, and then lies still."""
    switched_off(scene)
    angle_deg, axis, sign = LEANINGS[scene.variant]

    def rates(time_s: float) -> Axes:
        rate = sign * angle_deg / LEANS_S if time_s < LEANS_S else 0.0
        return (rate, 0.0, 0.0) if axis == 0 else (0.0, rate, 0.0)

    def forces(time_s: float) -> Axes:
        angle = math.radians(sign * angle_deg * min(time_s / LEANS_S, 1.0))
        side, up = math.sin(angle), math.cos(angle)
        return (0.0, side, up) if axis == 0 else (-side, 0.0, up)

    feels(scene, rates, forces)
    scene.run(LEANS_S + LIES_S)


def falls(scene: Scene) -> None:
    """It climbs, is switched off, and falls."""
    climbs(scene)
    switched_off(scene)
    weight(FELT_G[scene.variant])(scene)
    scene.run(FALLS_S)


def climbs(scene: Scene) -> None:
    weight(CLIMB_G)(scene)
    scene.run(CLIMBS_S)


def switches_on(scene: Scene) -> None:
    """The pilot switches the rotors on, then raises the throttle."""
    assert scene.pilot is not None
    for throttle, seconds in ((0.0, TRIES_S), (0.3, TRIES_S)):
        scene.pilot.says = throttle, True
        scene.run(seconds)


def falls_silent(scene: Scene) -> None:
    assert scene.pilot is not None
    scene.pilot.says = None


def is_silent_for_a_while(scene: Scene) -> None:
    assert scene.pilot is not None
    before, scene.pilot.says = scene.pilot.says, None
    scene.run(AWAY_S)
    scene.pilot.says = before


FAULTS = (
    Fault("take-off-leaning", "flights", "a vehicle that leans by 30 or 60 deg is switched on", switches_on, "unmoved",
          (LEANING,), needs=FLOWN, link=RECEIVER, prepare=leans, variants=len(LEANINGS)),
    Fault("take-off-falling", "flights", "a vehicle that was switched off in the air, and falls, is switched on again",
          switches_on, "unmoved", (MOVING,), needs=FLOWN, link=RECEIVER, prepare=falls, variants=len(FELT_G)),
    Fault("flown-receiver-silent-in-the-air", "flights", "no frame of the receiver comes, in the air", falls_silent,
          "hold", (BY_STEP, RECEIVER_LOST), needs=FLOWN, link=RECEIVER, prepare=climbs),
    Fault("flown-receiver-silent-for-a-while", "flights", f"no frame of the receiver comes for {AWAY_S:g} s in the air",
          is_silent_for_a_while, "hold", (ARMED,), needs=FLOWN, link=RECEIVER, prepare=climbs, moves_on=True),
)  # fmt: skip
