"""Four rotors at the pins of the flash image: their pulses change together, end when they must, and are low at once
when the program fails."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.snapshot import Snapshot
from plumb.proof.faults import core
from plumb.proof.faults.host import disarms
from plumb.proof.faults.scene import Scene, driving
from plumb.spec.speed_controllers import GAP_HALFUS, PULSE_US
from support.campaigns import campaign

IMAGE = Path(__file__).parents[2] / "build/images/quadrotor/firmware.bin"
pytestmark = [
    pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image"),
    pytest.mark.slow,
]
PINS = ("PA0", "PA1", "PA2", "PA3")
NEUTRAL_US, FRAME_US = 1000.0, 2500.0
LATEST_US = 10_000 + PULSE_US[1] + GAP_HALFUS / 2
"""From DISARM to neutral: a line on the UART, a turn of the loop, and the frame that runs."""
LOW_WITHIN_US = 12
"""From the failure of the crystal to four low pins: 96 cycles at 8 MHz, for the entry of the NMI and its start."""
PHASES = campaign(6, 200)
Taken = tuple[Scene, Snapshot]


@pytest.fixture(scope="module")
def taken() -> Iterator[Taken]:
    scene = driving("quadrotor", image=IMAGE)
    try:
        yield scene, scene.snapshot()
    finally:
        scene.board.close()


def pulses_us(scene: Scene) -> list[float]:
    return [scene.machine.pwm(pin).pulse_us for pin in PINS]


def test_four_pulses_turn_the_rotors_of_an_armed_vehicle(scene: Scene) -> None:
    waves = [scene.machine.pwm(pin) for pin in PINS]
    assert all(wave.enabled and wave.period_us == pytest.approx(FRAME_US) for wave in waves)
    assert all(1200.0 < wave.pulse_us < 1400.0 for wave in waves), "30 % of the throttle"
    assert not any(scene.machine.pwm(pin).enabled for pin in ("PB6", "PB7"))


def test_all_pulses_change_in_the_same_frame(scene: Scene) -> None:
    """Even when a frame ends between the writes of two of them: what a frame begins with is what a step wrote."""
    timer = scene.machine.tim2
    preload, write = timer._preload, timer._write_ccr
    written, begun = set[tuple[int, ...]](), list[tuple[int, ...]]()

    def frame() -> None:
        preload()
        begun.append(tuple(timer.active_ccr))

    def writes(index: int, value: int) -> None:
        write(index, value)
        if index == len(PINS) - 1:
            written.add((timer.ccr1, timer.ccr2, timer.ccr3, timer.ccr4))
        else:
            timer.zero_at = scene.machine.now + 1 - timer.period_ticks  # the frame ends here

    vars(timer).update(_preload=frame, _write_ccr=writes)
    scene.run(0.2)
    del vars(timer)["_preload"], vars(timer)["_write_ccr"]
    assert len(set(begun)) > 5, "the pulses follow the noise of the sensors"
    assert set(begun[1:]) <= written


def test_disarming_stops_all_rotors(scene: Scene) -> None:
    disarms(scene)
    scene.run(LATEST_US * 1e-6)
    assert pulses_us(scene) == [NEUTRAL_US] * 4


@pytest.mark.parametrize("phase", range(PHASES))
def test_a_crystal_that_fails_in_the_air_takes_all_pulses_away_at_once(scene: Scene, phase: int) -> None:
    """At 8 MHz a pulse on its way would last nine times as long. The reset, which lets the pins go, is held off."""
    machine = scene.machine
    scene.run(1e-6 * random.Random(phase).uniform(0.0, 2.0 * FRAME_US))
    machine.tim2.settle(machine.now)
    begun = machine.tim2.zero_at
    machine.advance_us((begun + machine.tim2.period_ticks - machine.now) / TICKS_PER_US + 150.0 * phase)
    core.hold_off(scene, "software")
    machine.rcc.kill_crystal()
    machine.advance_us(LOW_WITHIN_US)
    assert [machine.pin(pin) for pin in PINS] == [False] * 4
    assert not any(machine.pwm(pin).enabled for pin in PINS)
