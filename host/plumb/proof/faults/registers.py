"""Damage that the check of memory does not find: the values in the pulse registers must stay within their bounds, and
none may drive while nothing is armed.

The rows of bounds switch the check of guarded memory off, so that only the bounds behind it can act.
"""

from __future__ import annotations

from plumb.f103.peripherals.tim import UG
from plumb.f103.peripherals.tim1 import LOW_PINS, MOE
from plumb.proof.faults import core
from plumb.proof.faults.clock import disarmed
from plumb.proof.faults.fault import Fault
from plumb.proof.faults.host import COMMAND, disarms
from plumb.proof.faults.memory import UPSET
from plumb.proof.faults.outputs import PROGRAM
from plumb.proof.faults.reports import Told
from plumb.proof.faults.scene import Scene
from plumb.spec import declarations, images, parameters

ESC = frozenset({"esc"})
LONGEST_HALFUS = 16383
DRIVING_HALFUS = 4000
SHORT_FRAME = 4080 - 1
"""Reload value of the timer for the shortest frame, in which the longest pulse does not fit."""
OUTPUTS = {"PULSES": 2, "ROTORS": 4}
"""Pulses of a system, by its output."""
VARIANTS = max(OUTPUTS.values())
ALTERNATE = 0x9
"""Mode of a pin: output of a timer."""
ARMED = Told("STATUS", "armed", value=1)
BY_COMMAND = Told("EVENTS", "disarm_cause", COMMAND)


def unchecked(scene: Scene) -> None:
    """Make the check find guarded memory intact, whatever it holds. Injected while the loop sleeps, because a check
    that has begun runs to its end."""
    core.reach_sleep(scene)
    core.replace_function(scene, "board_memory_intact", core.RETURN_TRUE)


def set_parameter(scene: Scene, name: str, value: int) -> None:
    """Write a word of the parameters in use, in RAM, where the image holds those of its own systems alone."""
    held = images.held_groups(scene.session.require_match().systems)
    rows = [row.name for row in parameters.table() if not row.group or row.group in held]
    index = rows.index(name)
    core.poke(scene, scene.symbol("params").address + 4 * index, value)


def pulses_wild(scene: Scene) -> None:
    """Every pulse that the system computes is far too long; in variant 1 far too short, in variant 2 longer than its
    frame."""
    unchecked(scene)
    wanted = 0 if scene.variant == 1 else LONGEST_HALFUS
    for name in ("esc.min_halfus", "esc.mid_halfus", "esc.max_halfus"):
        set_parameter(scene, name, wanted)
    if scene.variant == 2:
        scene.pulses.timer.write_arr(SHORT_FRAME)


def neutral_wild(scene: Scene) -> None:
    """The neutral pulse would drive, in variant 1 it is far too short, when the host disarms."""
    unchecked(scene)
    core.poke(scene, scene.symbol("neutral_halfus").address, 0 if scene.variant else DRIVING_HALFUS)
    disarms(scene)


def frame_wild(scene: Scene) -> None:
    """The next run begins with a frame far too short, in variant 1 far too long."""
    unchecked(scene)
    set_parameter(scene, "esc_period_us", 32_000 if scene.variant else 1)
    scene.session.begin("REALTIME_LIVE")


def disarmed_for_a_while(scene: Scene) -> None:
    """Another part of a tick later in each variant."""
    disarmed(scene)
    scene.machine.advance_us(scene.variant * 1000 / VARIANTS)


def outputs_drive(scene: Scene) -> None:
    """Stray writes: one pulse, another one in each variant, is that of a motor that turns, and a frame begins; the main
    output enable of a bridge is set, and of the motors of two wheels with it pin and duty of the left one."""
    output, tim1 = declarations.system(scene.name).output, scene.machine.tim1
    if output in ("BRIDGE", "WHEELS"):
        if output == "WHEELS":
            pins = scene.machine.port(LOW_PINS[1])
            pins.write_crh(pins.crh & ~(0xF << 24) | ALTERNATE << 24)
            tim1.write_ccr2(tim1.arr // 2)
            tim1.write_egr(UG)
        tim1.write_bdtr(tim1.bdtr | MOE)
    else:
        timer = scene.pulses.timer
        getattr(timer, f"write_ccr{scene.variant % OUTPUTS[output] + 1}")(DRIVING_HALFUS)
        timer.write_egr(UG)


FAULTS = (
    Fault("pulses-wild", "memory", "the system computes pulses far out of their bounds", pulses_wild, "bounded",
          (ARMED,), ESC, moves_on=True, variants=3),
    Fault("neutral-wild", "memory", "the neutral pulse is out of its bounds, and the host disarms", neutral_wild,
          "command", (BY_COMMAND,), ESC, variants=2, by=PROGRAM),
    Fault("frame-wild", "memory", "a run begins with frames of pulses far out of their bounds", frame_wild, "command",
          (BY_COMMAND,), ESC, variants=2, by=PROGRAM),
    Fault("outputs-drive-disarmed", "memory", "a stray write lets an output drive, and nothing is armed", outputs_drive,
          "astray", (Told("STATUS", "faults", UPSET),), prepare=disarmed_for_a_while, variants=VARIANTS, by=PROGRAM),
)  # fmt: skip
