"""Faults of sensors: at the analog pins with the noise of the ADC, in the chips on I2C, and at the Hall inputs."""

from __future__ import annotations

import math
from collections.abc import Callable

from plumb.f103.attached.invensense import Invensense
from plumb.link import parameter_table
from plumb.link.identity import SENSOR_CAUSES
from plumb.proof.faults.fault import Action, Fault
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import CHECKED, ESTIMATE, Scene, arm, noise
from plumb.spec import parameters
from plumb.spec.parameter_file import by_name

LSB_V = 3.3 / 4096
GYRO, ACCEL_Y, ACCEL_Z = 0, 1, 2
"""Order of ADC_PINS of a system on analog sensors."""
ANALOG, CHIPS, BRIDGE = frozenset({"analog"}), frozenset({"chips"}), frozenset({"bridge"})
BREAK = frozenset({"break"})
HALL_FAULT, BREAK_FAULT, ADC_FAULT = 1 << 5, 1 << 4, 1
BLOCK_FAULT, BLOCK_IMPLAUSIBLE = 1 << 3, 1 << 11
DISARMED_BY_FAULT = Told("EVENTS", "disarm_cause", BLOCK_FAULT)
DISARMED_BY_DOUBT = Told("EVENTS", "disarm_cause", BLOCK_IMPLAUSIBLE)


def doubt(check: int) -> tuple[Told, ...]:
    """Disarmed by this check of plausibility."""
    return (DISARMED_BY_DOUBT, Told("PLAUSIBILITY", "disarmed_by", check))


GYRO_BACK, ACCEL_BACK = (Told("SENSORS", "digital", 0xFF << shift, passes=True) for shift in (0, 8))
"""Reports when a chip has lost its settings: the board reports it, sets it up anew, and reports it good again."""
ACCEL, INNOVATION, RATE = (doubt(1 << bit) for bit in range(3))


def volts_now(scene: Scene, channel: int) -> float:
    """Volts of an analog pin at this moment; advances the plant to it."""
    return scene.machine.adc.sampled(scene.adc_pins[channel], scene.machine.now_s)


def held(channel: int, volts: float | None = None, noise_lsb: float = 0.0) -> Action:
    """Hold an analog pin at a voltage (None: the present one), with noise at the pin."""

    def inject(scene: Scene) -> None:
        level = volts_now(scene, channel) if volts is None else volts
        added = noise(f"channel {channel}", noise_lsb * LSB_V)
        scene.machine.adc[scene.adc_pins[channel]] = lambda time_s: level + added(time_s)

    return inject


def wild(channel: int, sigma_v: float) -> Action:
    """Add noise to the voltage of an analog pin."""

    def inject(scene: Scene) -> None:
        pin = scene.adc_pins[channel]
        source, added = scene.machine.adc[pin], noise(f"wild {channel}", sigma_v)
        scene.machine.adc[pin] = lambda time_s: (source(time_s) if callable(source) else source) + added(time_s)

    return inject


def unplugged(scene: Scene) -> None:
    """No sensor drives its pin; the pull-downs of the sensor board remain."""
    for pin in scene.adc_pins:
        scene.machine.adc[pin] = 0.0


def converter_stops(scene: Scene) -> None:
    scene.machine.adc1.silent = True


def chip(which: str, **attributes: object) -> Action:
    """Set attributes of a chip's model. which: gyro or accel, of the coupling."""

    def inject(scene: Scene) -> None:
        for name, value in attributes.items():
            setattr(getattr(scene.coupling, which), name, value)

    return inject


def browned_out(which: str) -> Action:
    """A chip's supply dips: its registers are as after power-up, and it sleeps."""

    def inject(scene: Scene) -> None:
        getattr(scene.coupling, which).brown_out()

    return inject


def felt(which: str, world: Callable[[tuple[float, float, float]], tuple[float, float, float]], sigma: float) -> Action:
    """A chip measures world(true value) instead of the true value, with noise."""

    def inject(scene: Scene) -> None:
        target = getattr(scene.coupling, which)
        measured = "forces" if which == "accel" and isinstance(target, Invensense) else "source"
        level = world(getattr(target, measured)(scene.machine.now_s))
        added = [noise(f"{which} {axis}", sigma) for axis in range(3)]

        def source(time_s: float) -> tuple[float, float, float]:
            x, y, z = (value + one(time_s) for value, one in zip(level, added, strict=True))
            return x, y, z

        setattr(target, measured, source)

    return inject


def hall(state: int) -> Action:
    """Hold all three Hall inputs at the same level."""

    def inject(scene: Scene) -> None:
        scene.machine.set_hall(state)
        vars(scene.machine)["set_hall"] = lambda _state: None

    return inject


def broken(scene: Scene) -> None:
    """The driver pulls the break input."""
    scene.machine.drive(scene.break_pin, False)


def digital(cause: str, shift: int) -> Told:
    """SENSORS names this cause for the gyro (shift 0) or the accelerometer (8)."""
    number = next(key for key, text in SENSOR_CAUSES.items() if text == cause)
    return Told("SENSORS", "digital", number << shift, field=0xFF << shift)


def stuck(channel: int) -> tuple[Told, ...]:
    return (DISARMED_BY_FAULT, Told("SENSORS", "analog", 1 << 8 + channel))


def railed(channel: int) -> tuple[Told, ...]:
    return (DISARMED_BY_FAULT, Told("SENSORS", "analog", 1 << channel))


def turned(degrees: float, over_s: float = 0.0) -> Action:
    """Both accelerometer pins show a turn of the vehicle by `degrees` in `over_s`, with 1 g and noise of 1 LSB. The
    length is 1 g, and not that of the last sample, whose noise could make the filter's R ten times as large."""
    volts_per_g, level_v = 0.8, 1.65

    def inject(scene: Scene) -> None:
        begin_s = scene.machine.now_s
        y, z = ((volts_now(scene, channel) - level_v) / volts_per_g for channel in (ACCEL_Y, ACCEL_Z))
        tilt = math.atan2(y, z)

        def pin(channel: int, part: Callable[[float], float]) -> None:
            added = noise(f"channel {channel}", LSB_V)

            def volts(time_s: float) -> float:
                share = min((time_s - begin_s) / over_s, 1.0) if over_s else 1.0
                angle = tilt + math.radians(degrees) * share
                return level_v + volts_per_g * part(angle) + added(time_s)

            scene.machine.adc[scene.adc_pins[channel]] = volts

        pin(ACCEL_Y, math.sin)
        pin(ACCEL_Z, math.cos)

    return inject


Q_ANGLE, Q_BIAS = ("kalman.qa_hi", "kalman.qa_lo", 32), ("kalman.qb", "kalman.qb_frac_q30", 30)
"""Growth of the variances of angle and bias in a step: upper and lower word, bits of the lower one."""
R_GAIN = "tilt.r_gain"
NOMINAL_US = 5000
"""Period of the shipped table, at which the filter's gain is at most 1.6 per second."""
SETTLED_S = 3.0
"""Time after arming until the filter's gain is so low that an innovation lasts for longer than its check."""


def settled(scene: Scene) -> None:
    scene.run(SETTLED_S)


def begun_without_sigma(scene: Scene, q_angle_times: int = 1) -> None:
    """Begin a new run, and arm as soon as the board allows it. R is constant and the table has no unit of variance, so
    that an innovation counts from 15 deg on; with a unit, a large R would require 6 sigma, and another check would act
    first. Q has one more factor of the period than in a tuning, so that the gain per second is the same at every
    period."""
    scene.session.end()
    table = by_name(parameter_table.read_table(scene.session))
    changes = {parameters.UNIT: 0, R_GAIN: 0}
    for (high, low, bits), times in ((Q_ANGLE, q_angle_times), (Q_BIAS, 1)):
        grown = ((table[high] << bits) + table[low]) * times * table["period_us"] // NOMINAL_US
        changes |= {high: grown >> bits, low: grown % (1 << bits)}
    parameter_table.commit(scene.session, {**table, **changes})
    scene.session.begin("REALTIME_LIVE", frames=scene.live.FRAMES)
    arm(scene)


def armed_with_high_gain(scene: Scene) -> None:
    """A filter with a gain above 2 per second, as soon after its start; a large Q keeps the gain high here."""
    begun_without_sigma(scene, 64)


def turned_slowly(scene: Scene) -> None:
    """Settle, then turn so slowly that gyro and accelerometer differ by less than 15 deg in 0.25 s: only the innovation
    shows it."""
    begun_without_sigma(scene)
    settled(scene)
    turned(TURNED_DEG, SLOWLY_S)(scene)
    scene.run(SLOWLY_S)


TURNED_DEG = 28.0
"""An innovation of this size falls to 15 deg after 300 ms with a gain of 2 per second."""
SLOWLY_S = 0.4

LIMITS = {ACCEL: "force", INNOVATION: "innovation", RATE: "rate"}
"""Limit of the faults that only one check of plausibility can find; other faults of sensors have the limit `sensor`."""

_ANALOG = tuple(
    Fault(name, "sensors", what, inject, LIMITS.get(told, "sensor"), told, ANALOG,
          prepare=settled if told in LIMITS else None)
    for name, what, inject, told in (
        ("gyro-frozen", "pin of the gyro held at its last voltage, no noise", held(GYRO), stuck(GYRO)),
        ("accel-y-frozen", "pin of accelerometer y held at its last voltage, no noise", held(ACCEL_Y), stuck(ACCEL_Y)),
        ("accel-z-frozen", "pin of accelerometer z held at its last voltage, no noise", held(ACCEL_Z), stuck(ACCEL_Z)),
        ("gyro-at-ground", "pin of the gyro at 0 V", held(GYRO, 0.0), railed(GYRO)),
        ("gyro-at-supply", "pin of the gyro at 3.3 V", held(GYRO, 3.3), railed(GYRO)),
        ("accel-y-at-ground", "pin of accelerometer y at 0 V", held(ACCEL_Y, 0.0), railed(ACCEL_Y)),
        ("accel-z-at-supply", "pin of accelerometer z at 3.3 V", held(ACCEL_Z, 3.3), railed(ACCEL_Z)),
        ("gyro-held-off", "pin of the gyro at 2.2 V, 1 LSB rms of noise", held(GYRO, 2.2, 1.0), RATE),
        ("accel-y-at-3v", "pin of accelerometer y at 3.0 V, 1 LSB rms of noise: it turns", held(ACCEL_Y, 3.0, 1.0),
         RATE),
        ("accel-z-at-3v", "pin of accelerometer z at 3.0 V, 1 LSB rms of noise", held(ACCEL_Z, 3.0, 1.0),
         ACCEL),
        ("accel-y-wild", "0.5 V rms (0.6 g) of noise on the pin of accelerometer y", wild(ACCEL_Y, 0.5),
         (DISARMED_BY_DOUBT,)),
        ("sensors-unplugged", "every sensor pin at 0 V", unplugged,
         (*railed(GYRO), *railed(ACCEL_Y), *railed(ACCEL_Z))),
        ("converter-stops", "the ADC makes no conversions any more", converter_stops,
         (Told("STATUS", "faults", ADC_FAULT), DISARMED_BY_FAULT)),
    )
)  # fmt: skip

_TURNED = f"pins of the accelerometer as after a turn by {TURNED_DEG:g} deg, 1 LSB rms of noise"
_ANGLES = (
    Fault("accel-turned", "sensors", f"{_TURNED}, {SETTLED_S:g} s after arming", turned(TURNED_DEG), "turn",
          RATE, ANALOG, prepare=settled),
    Fault("accel-turned-slowly", "sensors", f"{_TURNED} in {SLOWLY_S:g} s, from its end on", lambda _scene: None,
          "innovation", INNOVATION, ANALOG, prepare=turned_slowly),
    Fault("accel-turned-soon", "sensors", f"{_TURNED}, while the gain is high", turned(TURNED_DEG),
          "innovation_soon", INNOVATION, ANALOG, prepare=armed_with_high_gain),
)  # fmt: skip

_CHIPS = tuple(
    Fault(name, "sensors", what, inject, LIMITS.get(told, "sensor"), told,
          CHIPS | {CHECKED} if DISARMED_BY_DOUBT in told else CHIPS, prepare=settled if told in LIMITS else None)
    for name, what, inject, told in (
        ("gyro-silent", "the gyro does not acknowledge", chip("gyro", answers=False),
         (DISARMED_BY_FAULT, digital("does not answer", 0))),
        ("accel-silent", "the accelerometer does not acknowledge", chip("accel", answers=False),
         (DISARMED_BY_FAULT, digital("does not answer", 8))),
        ("gyro-frozen", "the data registers of the gyro keep their values", chip("gyro", frozen=True),
         (DISARMED_BY_FAULT, Told("SENSORS", "digital", 0x00FF))),
        ("accel-frozen", "the data registers of the accelerometer keep their values", chip("accel", frozen=True),
         (DISARMED_BY_FAULT, Told("SENSORS", "digital", 0xFF00))),
        ("gyro-browned-out", "the supply of the gyro dips: settings lost", browned_out("gyro"),
         (DISARMED_BY_FAULT, GYRO_BACK)),
        ("accel-browned-out", "the supply of the accelerometer dips: settings lost", browned_out("accel"),
         (DISARMED_BY_FAULT, ACCEL_BACK)),
        ("gyro-held-off", "the gyro measures 150 deg/s too much, with its noise",
         felt("gyro", lambda at: (at[0], at[1] + 150.0, at[2]), 0.5), RATE),
        ("accel-at-2g", "the accelerometer measures 2.2 times what it should, with its noise: no tilt",
         felt("accel", lambda at: (2.2 * at[0], 2.2 * at[1], 2.2 * at[2]), 0.005), ACCEL),
        ("accel-without-gravity", "the accelerometer measures 0.3 of what it should, with its noise",
         felt("accel", lambda at: (0.3 * at[0], 0.3 * at[1], 0.3 * at[2]), 0.005), ACCEL),
        ("accel-wild", "1 g rms of noise on the accelerometer",
         felt("accel", lambda at: at, 1.0), (DISARMED_BY_DOUBT,)),
    )
)  # fmt: skip

_ESTIMATES = tuple(
    Fault(f"estimate-{name}", "sensors", what, inject, "sensor", told, CHIPS | {ESTIMATE})
    for name, what, inject, told in (
        ("gyro-silent", "the gyro does not acknowledge, and nothing is armed", chip("gyro", answers=False),
         (digital("does not answer", 0),)),
        ("accel-silent", "the accelerometer does not acknowledge, and nothing is armed", chip("accel", answers=False),
         (digital("does not answer", 8),)),
        ("gyro-frozen", "the data registers of the gyro keep their values, and nothing is armed",
         chip("gyro", frozen=True), (Told("SENSORS", "digital", 0x00FF),)),
        ("accel-frozen", "the data registers of the accelerometer keep their values, and nothing is armed",
         chip("accel", frozen=True), (Told("SENSORS", "digital", 0xFF00),)),
        ("gyro-browned-out", "the supply of the gyro dips: settings lost, and nothing is armed", browned_out("gyro"),
         (GYRO_BACK,)),
        ("accel-browned-out", "the supply of the accelerometer dips: settings lost, and nothing is armed",
         browned_out("accel"), (ACCEL_BACK,)),
    )
)  # fmt: skip

_HALL = tuple(
    Fault(name, "sensors", what, inject, "sensor", told, BRIDGE)
    for name, what, inject, told in (
        ("hall-high", "all three Hall inputs high", hall(7), (Told("STATUS", "faults", HALL_FAULT), DISARMED_BY_FAULT)),
        ("hall-low", "all three Hall inputs low", hall(0), (Told("STATUS", "faults", HALL_FAULT), DISARMED_BY_FAULT)),
    )
)  # fmt: skip

_BREAK = (
    Fault("break-input", "sensors", "the driver pulls the break input low", broken, "sensor",
          (Told("STATUS", "faults", BREAK_FAULT), DISARMED_BY_FAULT), BREAK),
)  # fmt: skip

FAULTS = _ANALOG + _ANGLES + _CHIPS + _ESTIMATES + _HALL + _BREAK
