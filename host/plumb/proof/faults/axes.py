"""Faults of single axes of a digital sensor, and of its settings: it answers, and what it says is wrong.

Each of them on a board that a host has armed, on one that a pilot flies, and on one that drives nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from plumb.f103.attached import adxl345, invensense, itg3205
from plumb.f103.attached.invensense import Invensense
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.flights import BY_STEP, CHIPS, NO_SAMPLES
from plumb.proof.faults.scene import ESTIMATE, RECEIVER, Scene
from plumb.proof.faults.sensors import ACCEL_BACK, DISARMED_BY_DOUBT, DISARMED_BY_FAULT, GYRO_BACK, chip, digital
from plumb.proof.faults.sensors import CHIPS as CHIPS_ALONE
from plumb.spec import imu_chips

GYRO, ACCEL = "gyro", "accel"
FAR = 1e4
"""Beyond the range of every sensor, in its unit."""
ALL = (0, 1, 2)
EVERY: tuple[tuple[int, ...], ...] = ((0,), (1,), (2,), ALL)
"""Axes that lie, by variant, where a system has all of them."""
SHARED: dict[str, tuple[tuple[int, ...], ...]] = {GYRO: ((1,), ALL), ACCEL: ((0,), ALL)}
"""Axes that every system has, by sensor."""
FLICKERS_S = (0.1, 0.2)
"""From one visit at the rail to the next, by variant; each is in one reading of the board or in two."""
SILENT_S = 0.045
RANGES = {
    **{
        chip.name: {GYRO: invensense.GYRO_CONFIG, ACCEL: invensense.ACCEL_CONFIG}
        for chip in imu_chips.chips().values()
        if chip.invensense
    },
    itg3205.Itg3205.NAME: {GYRO: itg3205.DLPF_FS},
    adxl345.Adxl345.NAME: {ACCEL: adxl345.DATA_FORMAT},
}
"""Register that holds the range, by chip and sensor."""
NAMES = {GYRO: "gyro", ACCEL: "accelerometer"}
SHIFTS = {GYRO: 0, ACCEL: 8}
BACK = {GYRO: GYRO_BACK, ACCEL: ACCEL_BACK}
UNTRUE = "another chip answers, or it did not take its settings"
DISARMED = (DISARMED_BY_FAULT, DISARMED_BY_DOUBT, BY_STEP)
"""Any of these may come first: a step that takes rates at the rail for a fall stops the motors by itself."""


def lies(which: str, axes: Sequence[int], value: Callable[[float, float], float]) -> Action:
    """These axes of a sensor read value(true value, time in s), the others the truth."""

    def inject(scene: Scene) -> None:
        chip = getattr(scene.coupling, which)
        source_name = "forces" if which == ACCEL and isinstance(chip, Invensense) else "source"
        honest = getattr(chip, source_name)

        def source(time_s: float) -> tuple[float, float, float]:
            x, y, z = (value(at, time_s) if axis in axes else at for axis, at in enumerate(honest(time_s)))
            return x, y, z

        setattr(chip, source_name, source)

    return inject


def at_rail(which: str, axes: Sequence[Sequence[int]]) -> Action:
    """These axes are at their upper rail, by variant."""
    return lambda scene: lies(which, axes[scene.variant], lambda _at, _time_s: FAR)(scene)


def flickers(which: str, axes: Sequence[Sequence[int]]) -> Action:
    """An axis is at its rail for a moment, again and again. The chip samples by a clock of its own: a visit that is
    shorter than a period of the board and one of the chip may lie between two readings."""

    def inject(scene: Scene) -> None:
        every_s, visit_s = FLICKERS_S[scene.variant], scene.period_s + getattr(scene.coupling, which).period_s()
        lies(which, axes[0], lambda at, time_s: FAR if time_s % every_s < visit_s else at)(scene)

    return inject


def stands(which: str, axes: Sequence[Sequence[int]]) -> Action:
    """These axes keep their values, without noise, by variant; the others live."""

    def inject(scene: Scene) -> None:
        kept: dict[int, float] = {}

        def value(at: float, _time_s: float, axis: int) -> float:
            return kept.setdefault(axis, at)

        for axis in axes[scene.variant]:
            lies(which, (axis,), partial(value, axis=axis))(scene)

    return inject


def loses_its_range(which: str) -> Action:
    """The register that holds the range falls back to its value after power-up."""

    def inject(scene: Scene) -> None:
        chip = getattr(scene.coupling, which)
        chip.registers[RANGES[chip.NAME][which]] = 0

    return inject


def keeps_no_range(which: str) -> Action:
    """The same, and it does not take it again."""

    def inject(scene: Scene) -> None:
        chip = getattr(scene.coupling, which)
        register, honest = RANGES[chip.NAME][which], chip.written
        chip.registers[register] = 0
        vars(chip)["written"] = lambda at, value: None if at == register else honest(at, value)

    return inject


def answers_again(scene: Scene) -> None:
    """The chip does not acknowledge for a while, and keeps its settings."""
    chip("gyro", answers=False)(scene)
    scene.run(SILENT_S)
    chip("gyro", answers=True)(scene)


def _rows(which: str, axes: Sequence[Sequence[int]]) -> tuple[Fault, ...]:
    """The rows of a sensor on a board that a host has armed."""
    name, shift = NAMES[which], SHIFTS[which]
    limit, still, unset = (digital(cause, shift) for cause in ("is at its limit", "its data do not change", UNTRUE))
    return (
        Fault(f"{which}-axis-at-rail", "sensors", f"an axis of the {name}, or all, at its rail, the other sensor lives",
              at_rail(which, axes), "rail", (DISARMED, limit), CHIPS, variants=len(axes)),
        Fault(f"{which}-axis-flickers", "sensors", f"an axis of the {name} is at its rail for a moment now and then",
              flickers(which, axes), "flicker", (DISARMED, limit), CHIPS, variants=len(FLICKERS_S)),
        Fault(f"{which}-axis-frozen", "sensors", f"an axis of the {name}, or all, keeps its value, the other sensor"
              " lives", stands(which, axes), "sensor", (DISARMED, still), CHIPS, variants=len(axes)),
        Fault(f"{which}-range-lost", "sensors", f"the register with the range of the {name} falls back",
              loses_its_range(which), "settings", (DISARMED, BACK[which]), CHIPS),
        Fault(f"{which}-range-refused", "sensors", f"the register with the range of the {name} falls back, and takes no"
              " value", keeps_no_range(which), "settings", (DISARMED, unset), CHIPS),
    )  # fmt: skip


def _estimates(which: str) -> tuple[Fault, ...]:
    return tuple(
        replace(fault, name=f"estimate-{fault.name}", what=f"{fault.what}; nothing is armed", told=fault.told[1:],
                needs=CHIPS_ALONE | {ESTIMATE})
        for fault in _rows(which, EVERY) if "frozen" not in fault.name
    )  # fmt: skip


def _flown(which: str, fault: Fault) -> Fault:
    """Without the gyro, or the chip that has it, the step stops the rotors; without accelerations it flies on. Rates at
    the rail may look like a runaway before the samples count as missing."""
    stops = fault.name.endswith("refused") or (which == GYRO and not fault.name.endswith("lost"))
    reasons = (BY_STEP,) if fault.limit in ("rail", "flicker") else (BY_STEP, NO_SAMPLES)
    return replace(
        fault, name=f"flown-{fault.name}", group="flights", what=f"{fault.what}, while a pilot flies",
        told=(*(reasons if stops else ()), *fault.told[1:]), needs=CHIPS, link=RECEIVER, moves_on=not stops,
    )  # fmt: skip


FAULTS = (
    *(replace(fault, needs=CHIPS_ALONE) for which in (GYRO, ACCEL) for fault in _rows(which, SHARED[which])),
    *(fault for which in (GYRO, ACCEL) for fault in _estimates(which)),
    *(_flown(which, fault) for which in (GYRO, ACCEL) for fault in _rows(which, EVERY)),
    Fault("flown-sensor-silent-for-45-ms", "flights", "the sensor does not acknowledge for 45 ms, while a pilot flies",
          answers_again, "sensor", (GYRO_BACK,), needs=CHIPS, link=RECEIVER, moves_on=True, phases=True),
)  # fmt: skip
