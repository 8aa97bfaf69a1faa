"""Bits and values of the words that report a state: their names in the DBC for other tools, and their texts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from plumb.spec import declarations
from plumb.spec.system import StopReason


class Bit(NamedTuple):
    """name: small letters, part of a signal's name. text: a sentence, or the end of one."""

    name: str
    text: str


BLOCKED = {
    0: Bit("no_host", "no host of its version has connected"),
    1: Bit("no_run", "no run is on"),
    2: Bit("lockstep", "in lockstep nothing can be armed: begin a run in real time"),
    3: Bit("fault", "the board has a fault"),
    4: Bit("link_closed", "the link is closed or read-only"),
    5: Bit("keepalive_lost", "the keep-alive was lost"),
    6: Bit("commanded", "the host disarmed"),
    7: Bit("no_samples", "no injected samples come, or old ones, or too many are lost"),
    8: Bit("switch_opened", "the arm switch was opened"),
    9: Bit(
        "pins",
        "this system has nothing to move on these pins: wire the strap for it, set the parameter pins, save and reset",
    ),
    10: Bit("switch_closed", "the arm switch is closed: it holds the board armed, or has to be opened first"),
    11: Bit("implausible", "the sensors are implausible"),
    12: Bit("not_ready", "it is not ready to be armed"),
    13: Bit("other_link", "another link began the run, and alone may arm"),
    14: Bit("parameter", "with its parameters an armed board would break a promise: plumb doctor names the parameter"),
    15: Bit("motors_stopped", "the step has stopped the motors: what stopped them has to go first"),
}
"""Why arming is refused (STATUS.blocked), and what ended the last armed time (EVENTS.disarm_cause)."""
FAULTS = {
    0: Bit("no_conversions", "no conversions"),
    1: Bit("steps_missed", "control steps were missed, or none comes"),
    2: Bit("processor", "a processor fault ended the run before"),
    3: Bit("flash", "the flash does not hold what was built"),
    4: Bit("bridge_break", "the break input switched the motors off: look at the driver, and whether PB12 is wired"),
    5: Bit("hall", "all three Hall sensors say the same: a wire is off"),
    6: Bit("sensor", "a sensor is lost or not to be trusted"),
    7: Bit("saved_parameters", "the saved parameters cannot be used: load, reset or set them, then save"),
    8: Bit("internal_clock", "running on the internal oscillator"),
    9: Bit("bytes_lost", "received bytes were lost"),
    10: Bit("watchdog", "a watchdog ended the run before"),
    11: Bit("can_frames_lost", "received CAN frames were lost"),
    12: Bit("crystal", "the crystal failed in the run before"),
    13: Bit("loop_hung", "while it drove, the board's main loop hung for 20 ms: begin a new run"),
    14: Bit(
        "memory", "memory that decides a pulse was damaged, by radiation or by a fault of the program: reset the board"
    ),
    15: Bit(
        "strap",
        "the strap and the saved parameter pins disagree: no actuator pin is driven; rewire the strap, or set pins and "
        "save, then reset",
    ),
}
"""STATUS.faults."""
IMPLAUSIBLE = {
    0: Bit(
        "acceleration",
        "the accelerometer reads an acceleration that the system cannot have: check its wiring and supply",
    ),
    1: Bit(
        "innovation",
        "the accelerometer's tilt is far from what the filter expects: check the axes of gyro and accelerometer",
    ),
    2: Bit(
        "turn",
        "gyro and accelerometer do not turn together: check the gyro's wiring, supply, axis and sign, and on wheels "
        "what counts them",
    ),
    3: Bit("own", "a check of the system's own fails: the flags of its step say which"),
}
"""PLAUSIBILITY.failed and disarmed_by: plumb/plausibility.h. From STOP_REASON_SHIFT on they have the word `stop_reason`
of a step, whose bits its system declares (`stop_reason_texts`)."""
STOP_REASON_SHIFT = 8
NOT_READY = {
    0: Bit("settling", "it has not been ready for 0.3 s yet"),
    1: Bit("at_rest", "it moves: hold it still"),
    2: Bit("converged", "the filter has not converged: hold it still"),
    3: Bit("setpoint", "the setpoint is not 0"),
    4: Bit("tilt", "it is tilted too far: bring it level or upright"),
    5: Bit("receiver_frames", "no frames from the pilot's receiver"),
    6: Bit("rotors_off", "the pilot's switch is on: switch the motors off first"),
    7: Bit("lock_open", "the arm switch on the board is closed: it locks out the pilot"),
    8: Bit("battery_full", "the battery is low: charge it, or set battery_min_mv lower"),
    9: Bit("battery_known", "the battery's voltage is not known: check its plug, and its divider"),
    10: Bit("calibrated", "the sensors were never calibrated: run plumb calibrate"),
    11: Bit("own", "a condition of the system's own is not met: the flags of its step say which"),
}
"""PLAUSIBILITY.missing."""
ANALOG_INPUTS = ("PA0", "PA1", "PA2", "PA3", "PB0", "PB1")
"""SENSORS.analog: bits 0 to 5 of inputs at a rail, 8 to 13 of inputs that do not change."""
SENSOR_STATES = {
    0: Bit("GOOD", "good, or not in use"),
    1: Bit("NOT_FOUND", "not found yet"),
    2: Bit("NO_ANSWER", "does not answer"),
    3: Bit("BUS_HANGS", "its bus hangs"),
    4: Bit("OTHER_CHIP", "another chip answers, or it did not take its settings"),
    5: Bit("NO_DATA", "has no data"),
    6: Bit("UNCHANGED", "its data do not change"),
    7: Bit("AT_LIMIT", "is at its limit"),
}
"""SENSORS.digital: values of the low byte, the gyro, and of the high byte, the accelerometer."""


def _stop_reasons() -> Iterator[tuple[int, str, StopReason]]:
    """Bit of PLAUSIBILITY.failed, name of the system and reason, of every system; in the order of the bits."""
    found = [
        (STOP_REASON_SHIFT + reason.bit, name, reason)
        for name, declared in declarations.systems().items()
        for reason in declared.stop_reasons
    ]
    return iter(sorted(found, key=lambda one: one[0]))


def stop_reason_texts(system: str | None) -> dict[int, str]:
    """Bit of PLAUSIBILITY.failed -> why the step of this system stopped the motors. None: the system is not known, and
    a text names the systems that have it."""
    found: dict[int, str] = {}
    for bit, name, reason in _stop_reasons():
        if system is None:
            found[bit] = f"{found[bit]}, or {name}: {reason.doc}" if bit in found else f"{name}: {reason.doc}"
        elif name == system:
            found[bit] = reason.doc
    return found


def stop_reason_signals() -> dict[int, Bit]:
    """The same bits for the DBC, which no system has to itself: a signal has the names of all systems."""
    names: dict[int, list[str]] = {}
    for bit, _name, reason in _stop_reasons():
        names.setdefault(bit, []).append(reason.name)
    texts = stop_reason_texts(None)
    return {bit: Bit("_or_".join(dict.fromkeys(of)), texts[bit]) for bit, of in names.items()}


OWN_BITS = {"fails": 3, "unready": 11}
"""Effect of a flag (`plumb.spec.system.Flag`) -> its bit of PLAUSIBILITY.failed or of PLAUSIBILITY.missing."""


def own_check_texts(system: str | None, effect: str) -> dict[int, str]:
    """The bit of a system that checks its output itself -> what its flags of this effect say; {} for any other system,
    and for None, when it is not known."""
    flags = declarations.system(system).flags if system else ()
    said = " or ".join(flag.doc for flag in flags if getattr(flag, effect))
    return {OWN_BITS[effect]: said} if said else {}
