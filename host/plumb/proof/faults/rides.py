"""Faults while a rider's receiver holds a vehicle on wheels armed: what stops it, and what it has to bear."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.flights import BY_STEP, BY_SWITCH, says
from plumb.proof.faults.pilot import RIDER
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import RECEIVER, Scene
from plumb.proof.faults.sensors import DISARMED_BY_DOUBT
from plumb.spec import crsf

RIDDEN = frozenset({RIDER})
FALLEN, NOBODY, LYING = (Told("PLAUSIBILITY", "disarmed_by", 1 << bit) for bit in (13, 14, 15))
DOES_NOT_TURN = Told("PLAUSIBILITY", "disarmed_by", 1 << 2)
"""Wheels that turn in the air are no acceleration: gyro and accelerometer do not agree."""
SLIPS, LOST, ENCODERS = (Told("WHEELS_ANGLE", "flags", 1 << bit) for bit in (10, 11, 12))
FALLEN_DEG, UPRIGHT_DEG, STANDS_MPS = 45.0, 20.0, 0.15
PUSH_MPS2, FALLS_S = 30.0, 2.0
"""A push that nobody can balance, and the longest time until the vehicle has fallen."""
SLOWER, SLOWS_S = 0.1, 1.0
"""Share of the stick's way that is asked for on ice, and the time for which a wheel is on it."""
COMES_TO_REST_S = 2.5
HELD_DEG = 3.0
"""Tilt at which hands hold the vehicle in the air."""
LEFT, RIGHT = 1, 2


@runtime_checkable
class RiddenPlant(Protocol):
    """Plant of a vehicle on wheels, to which something may happen at any moment."""

    @property
    def time_s(self) -> float: ...

    def happens_now(self, what: str, *, seconds: float = ..., size: float = ..., number: int = ...) -> None: ...

    def truth(self, time_s: float, /) -> dict[str, float]: ...


def plant_of(scene: Scene) -> RiddenPlant:
    plant = getattr(scene.coupling, "plant", None)
    assert isinstance(plant, RiddenPlant)
    return plant


def truth(scene: Scene, name: str) -> float:
    plant = plant_of(scene)
    return plant.truth(plant.time_s)[name]


def steps_off(scene: Scene) -> None:
    """The rider leaves: his switch opens, or closes for 20 of 300 ms, by variant."""
    plant_of(scene).happens_now(("off", "chatter")[scene.variant])


def topples(scene: Scene) -> None:
    """It is pushed until it has fallen, forwards or backwards by variant."""
    plant_of(scene).happens_now("push", size=(PUSH_MPS2, -PUSH_MPS2)[scene.variant])
    assert scene.run_until(lambda: abs(truth(scene, "tilt_deg")) > FALLEN_DEG, FALLS_S)


def lies(scene: Scene) -> None:
    """Nothing more happens."""


def loses_the_receiver(scene: Scene) -> None:
    """No frame comes, or frames with a link quality of 0, by variant; it comes to rest."""
    assert scene.pilot is not None
    if scene.variant:
        scene.pilot.also = crsf.statistics(0)
    else:
        scene.pilot.says = None
    scene.run(COMES_TO_REST_S)


def slips(scene: Scene) -> None:
    """A wheel is on ice while the rider slows down, the left or the right one by variant."""
    assert scene.pilot is not None
    plant_of(scene).happens_now("icy", seconds=SLOWS_S, number=(LEFT, RIGHT)[scene.variant])
    scene.pilot.pitch = SLOWER
    scene.run(SLOWS_S)


def encoders_die(scene: Scene) -> None:
    """Neither encoder counts any more."""
    vars(scene.machine)["turn_encoder"] = lambda _timer, _counts: None


def comes_to_rest(scene: Scene) -> None:
    assert scene.pilot is not None
    scene.pilot.pitch = 0.0
    scene.run(COMES_TO_REST_S)


def is_lifted(scene: Scene) -> None:
    """Hands lift it, leant forwards or backwards by variant, with its rider's switch closed."""
    plant_of(scene).happens_now("lift", size=(HELD_DEG, -HELD_DEG)[scene.variant])


def is_upright(scene: Scene) -> str:
    tilt_deg = truth(scene, "tilt_deg")
    return "" if abs(tilt_deg) < UPRIGHT_DEG else f"it leans by {tilt_deg:.0f} deg"


def stands(scene: Scene) -> str:
    speed_mps = truth(scene, "velocity_mps")
    return is_upright(scene) or ("" if abs(speed_mps) < STANDS_MPS else f"it goes at {speed_mps:.2f} m/s")


def _row(name: str, what: str, inject: Action, limit: str, told: tuple[Told, ...], **more: object) -> Fault:
    return Fault(f"ridden-{name}", "rides", what, inject, limit, told, RIDDEN, RECEIVER, **more)  # type: ignore[arg-type]


FAULTS = (
    _row("rider-gone", "the rider leaves: his switch opens, or closes for 20 of 300 ms", steps_off, "dismount",
         (BY_STEP, NOBODY), variants=2),
    _row("fallen", f"a push, and the vehicle leans by {FALLEN_DEG:g} deg", lies, "fallen", (BY_STEP, FALLEN),
         prepare=topples, variants=2),
    _row("receiver-lost", "no frame of the receiver comes, or its link quality is 0, at 0.4 m/s", loses_the_receiver,
         "ride", (LOST,), moves_on=True, judge=stands, variants=2),
    _row("wheel-slips", "a wheel on ice, left or right, while the rider slows down", slips, "slip", (SLIPS,),
         moves_on=True, judge=is_upright, variants=2),
    _row("encoders-dead", "neither encoder counts any more, at 0.4 m/s", encoders_die, "encoders",
         (BY_STEP, LYING, ENCODERS)),
    _row("lifted", "hands lift the vehicle that stands, its rider's switch closed", is_lifted, "lifted",
         (DISARMED_BY_DOUBT, DOES_NOT_TURN),
         prepare=comes_to_rest, variants=2),
    _row("switched-off", "the rider switches the motors off", says((0.0, False)), "pilot", (BY_SWITCH,)),
)  # fmt: skip
