"""Two wheels at the pins of the flash image `wheels`: what the motors' pins do for a duty, what lowers them, and what
encoders and rider's switch become."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from unicorn.arm_const import UC_ARM_REG_LR, UC_ARM_REG_R0

from plumb.errors import LinkError, UsageError
from plumb.f103.core.cpu import FLASH_BASE, RAM_BASE
from plumb.f103.peripherals.tim1 import MOE, Tim1
from plumb.f103.snapshot import Snapshot
from plumb.flash.image import find_image
from plumb.proof.faults import core
from plumb.proof.faults.host import disarms
from plumb.proof.faults.scene import Scene, arm, driving
from plumb.spec.records import RECORDS
from plumb.systems.wheels.pins import BREAK_PIN, MOTORS, WheelsCoupling

pytestmark = pytest.mark.slow
PWM, DIRECTIONS = tuple(pins[0] for pins in MOTORS), tuple(pin for pins in MOTORS for pin in pins[1:])
FIELDS: Mapping[str, tuple[Any, ...]] = RECORDS["wheels"].fields or {}
PLACES = [FIELDS[f"duty_{side}_q15"][1] for side in ("left", "right")]
"""In the record of a step."""
COUNTS = 1800
"""Of half a period of 20 kHz, at 72 MHz."""
WRITTEN_US = 300
"""From the end of a step until its duties are written, and a period of the PWM."""
AT_ONCE_US = 16
"""128 cycles at 8 MHz, for the entry of a fault and the 51 instructions of its start."""
STALL_US = 22_000
"""20 ticks of a millisecond, and two."""
LOOP_US = 6_000
"""A turn of the loop, and a line on the UART."""
BRIDGE, HARD, CRYSTAL, STALLED = 0x10, 0x4, 0x1000, 0x2000
Taken = tuple[Scene, Snapshot]


@pytest.fixture(scope="module")
def taken() -> Iterator[Taken]:
    """Armed by a host; the hand still holds it."""
    try:
        image = find_image(Path("wheels"))
    except UsageError as error:
        pytest.skip(str(error))
    scene = driving("wheels", image=image)
    try:
        yield scene, scene.snapshot()
    finally:
        scene.board.close()


def duties(scene: Scene) -> list[float | None]:
    return [scene.machine.duty(pin) for pin in PWM]


def directions(scene: Scene) -> list[bool | None]:
    return [scene.machine.pin(pin) for pin in DIRECTIONS]


def pwm_low(scene: Scene) -> bool:
    """Driven low by the port, or by nothing but the pull-downs of the wiring."""
    gates = [scene.machine.tim1.gate(pin, scene.machine.now) for pin in PWM]
    return duties(scene) == [None, None] == gates and True not in [scene.machine.pin(pin) for pin in PWM]


def all_low(scene: Scene) -> bool:
    """Driven low, all six."""
    driven = [scene.machine.pin(pin) for pin in PWM]
    return pwm_low(scene) and driven == [False] * 2 and directions(scene) == [False] * 4


def moves(scene: Scene) -> bool:
    return all(duties(scene)) and sum(map(bool, directions(scene))) == 2


@contextmanager
def switched_on(timer: Tim1) -> Iterator[list[list[int]]]:
    """The compare values in force when the main output is switched on."""
    look, begun = timer._look, list[list[int]]()

    def looks(now: int) -> None:
        look(now)
        if timer.bdtr & MOE and not begun:
            begun.append(timer.active_ccr[1:3])

    vars(timer)["_look"] = looks
    try:
        yield begun
    finally:
        del vars(timer)["_look"]


def said_faults(scene: Scene) -> int:
    faults = scene.session.telemetry["STATUS"]["faults"]
    assert isinstance(faults, int)
    return faults


class Duties:
    """The words of both duties in the record of the step that the loop is about to write to the motors."""

    def __init__(self, scene: Scene, pause_s: float = 0.0) -> None:
        """pause_s: how long the loop then stands still."""
        cpu = scene.machine.cpu
        core.pause_at(scene, scene.symbol("plumb_wheels_step").address, 0.0)
        record, back = cpu.uc.reg_read(UC_ARM_REG_R0), cpu.uc.reg_read(UC_ARM_REG_LR)
        self._scene, self._at = scene, [record + place for place in PLACES]
        core.pause_at(scene, back & ~1, pause_s)

    def read(self) -> list[int]:
        ram = self._scene.machine.cpu.ram
        words = [bytes(ram[at - RAM_BASE : at - RAM_BASE + 4]) for at in self._at]
        return [int.from_bytes(word, "little", signed=True) for word in words]

    def replace(self, *duties_q15: int) -> None:
        for at, duty in zip(self._at, duties_q15, strict=True):
            core.poke(self._scene, at, duty)

    def are_followed(self, *duties_q15: int) -> None:
        """Once the loop has gone on, and a period of the PWM is over."""
        self._scene.machine.advance_us(WRITTEN_US)
        assert duties(self._scene) == [(min(abs(duty), 32767) * COUNTS >> 15) / COUNTS for duty in duties_q15]
        left, right = (duty >= 0 for duty in duties_q15)
        assert directions(self._scene) == [left, not left, right, not right]


def test_the_pins_follow_the_record_of_every_step(scene: Scene) -> None:
    seen = set()
    for _ in range(6):
        newest = Duties(scene)
        motors = newest.read()
        newest.are_followed(*motors)
        seen.add(tuple(motors))
    assert len(seen) > 3


@pytest.mark.parametrize(
    "wanted",
    [(9000, -12000), (-1, 0), (0, -32767), (32767, 1 << 16), (-(1 << 31), 40000), (-20000, (1 << 31) - 1)],
)
def test_a_sign_is_a_direction_and_a_size_is_a_share_of_the_pwm(scene: Scene, wanted: tuple[int, int]) -> None:
    """Of whatever is in memory: no share is more than that of the largest duty."""
    newest = Duties(scene)
    newest.replace(*wanted)
    newest.are_followed(*wanted)


def test_disarming_lowers_all_six_pins_and_arming_alone_drives_them_again(scene: Scene) -> None:
    """From duty 0 on: the timer holds nothing of the time before."""
    timer = scene.machine.tim1
    assert moves(scene)
    disarms(scene)
    scene.run(LOOP_US * 1e-6)
    assert all_low(scene)
    with switched_on(timer) as begun:
        scene.run(0.1)
        assert all_low(scene) and not begun
        arm(scene)
    scene.run(0.02)
    assert moves(scene) and begun == [[0, 0]]


def test_the_timer_never_drives_the_pin_where_the_uart_sends(scene: Scene) -> None:
    """PA9 is the plain output of channel 2, whose complementary one is the left motor's (RM0008 table 83)."""
    machine = scene.machine
    armed = machine.tim1.levels(1, machine.now)
    disarms(scene)
    scene.run(LOOP_US * 1e-6)
    assert armed[0] is machine.tim1.levels(1, machine.now)[0] is None and armed[1] is not None


def test_the_break_input_takes_the_pwm_away_without_an_instruction(scene: Scene) -> None:
    machine = scene.machine
    now = machine.now
    machine.drive(BREAK_PIN, False)
    assert machine.now == now and pwm_low(scene) and any(directions(scene))
    machine.advance_us(LOOP_US)
    assert all_low(scene)
    machine.drive(BREAK_PIN, True)
    scene.run(0.1)
    assert all_low(scene) and said_faults(scene) & BRIDGE and not scene.says_armed


def test_an_open_break_input_is_a_break(scene: Scene) -> None:
    scene.machine.drive(BREAK_PIN, None)
    assert pwm_low(scene)


def test_nothing_that_is_written_keeps_the_break_away(scene: Scene) -> None:
    """The timer's lock holds it."""
    timer = scene.machine.tim1
    timer.write_bdtr(MOE)
    scene.machine.drive(BREAK_PIN, False)
    assert pwm_low(scene)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_crash_lowers_all_six_pins_before_its_reset(scene: Scene, sign: int) -> None:
    newest = Duties(scene)
    newest.replace(sign * 9000, sign * 9000)
    newest.are_followed(sign * 9000, sign * 9000)
    core.hold_off(scene, "software")
    core.patch_the_loop(scene, core.UNDEFINED)
    scene.machine.advance_us(AT_ONCE_US)
    assert all_low(scene)


def test_a_crystal_that_fails_takes_the_pwm_away_at_once_and_then_the_directions(scene: Scene) -> None:
    core.hold_off(scene, "software")
    scene.machine.rcc.kill_crystal()
    assert pwm_low(scene)
    scene.machine.advance_us(AT_ONCE_US)
    assert all_low(scene)


def test_a_stall_on_the_way_to_arming_leaves_the_motors_off(scene: Scene) -> None:
    """The tick finds it behind the board's checks, and before the motors are switched on."""
    machine, at = scene.machine, scene.symbol("motors_arm").address
    disarms(scene)
    scene.run(LOOP_US * 1e-6)
    cpu, before = machine.cpu, machine.cpu.read(at, len(core.FOREVER))
    core.hold_off(scene, "iwdg", "wwdg")
    machine.flash.store(at - FLASH_BASE, core.FOREVER)
    cpu.forget_code()
    with pytest.raises(LinkError):
        scene.session.arm()
    assert cpu.pc == at
    machine.flash.store(at - FLASH_BASE, before)
    cpu.forget_code()
    with switched_on(machine.tim1) as begun:
        machine.advance_us(WRITTEN_US)
    assert cpu.pc != at and all_low(scene) and not begun


@pytest.mark.parametrize(("how", "said"), [("crash", HARD), ("crystal", CRYSTAL)])
def test_a_reset_leaves_the_motors_off_and_is_reported(scene: Scene, how: str, said: int) -> None:
    if how == "crash":
        core.patch_the_loop(scene, core.UNDEFINED)
    else:
        scene.machine.rcc.kill_crystal()
    scene.machine.advance_us(200_000)
    assert all_low(scene) and scene.identify()["FAULTS"] & said


def test_a_loop_that_hangs_is_noticed_by_the_tick(scene: Scene) -> None:
    core.hold_off(scene, "iwdg", "wwdg")
    core.patch_the_loop(scene, core.FOREVER)
    scene.machine.advance_us(STALL_US)
    assert all_low(scene)


def test_a_loop_that_goes_on_after_a_stall_writes_nothing(scene: Scene) -> None:
    """Not even what it was about to write."""
    timer = scene.machine.tim1
    write, written = timer._write_ccr, list[int]()

    def writes(index: int, value: int) -> None:
        write(index, value)
        written.append(value)

    assert any(Duties(scene, STALL_US * 1e-6).read()) and all_low(scene)
    vars(timer)["_write_ccr"] = writes
    scene.machine.advance_us(WRITTEN_US)
    del vars(timer)["_write_ccr"]
    assert all_low(scene) and not any(written)
    scene.run(0.1)
    assert all_low(scene) and said_faults(scene) & STALLED


def test_encoders_and_the_riders_switch_arrive_as_counts(scene: Scene) -> None:
    """Modulo 2^16; the switch closes to ground."""
    machine, coupling = scene.machine, scene.coupling
    assert isinstance(coupling, WheelsCoupling)
    plant = coupling.plant

    def counts() -> list[int]:
        scene.listen_anew()
        scene.run(0.02)
        found: list[int] = []
        for name in ("RAW_B", "RAW_C"):
            message = scene.session.protocol[name]
            newest = [one for one in scene.heard if one.identifier == message.identifier][-1]
            found += message.unpack(newest.data)[2:5]
        return found[1:4]

    left, right, rider = counts()
    machine.turn_encoder("TIM2", 1000)
    machine.turn_encoder("TIM4", -(1 << 15) - 7)
    vars(plant)["ridden"] = lambda time_s: False
    try:
        now = counts()
    finally:
        del vars(plant)["ridden"]
    moved = [(one - other) % (1 << 16) for one, other in zip(now, (left, right, rider), strict=True)]
    assert moved == [1000, (1 << 15) - 7, (1 << 16) - 1] and rider == 1
