"""Neutral ends the frame of pulses that runs: at the pins of the flash image, at phases all over the frame.

No pulse may become longer or shorter by it, and none may begin without a gap before it.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")

from plumb.f103.core.timeline import TICKS_PER_US
from plumb.f103.machine import Machine
from plumb.proof.faults.host import disarms
from plumb.proof.faults.memory import crash_without_reset
from plumb.proof.faults.scene import LISTEN_S, Scene, driving
from plumb.spec.speed_controllers import FRAME_MAX_US, FRAME_MIN_US, GAP_HALFUS, PULSE_US
from support.campaigns import campaign

IMAGE = Path(__file__).parents[2] / "build/stm32f103/firmware.bin"
pytestmark = pytest.mark.skipif(not IMAGE.exists(), reason="the flash image is not built: run make image")
ENDED_US = PULSE_US[1] + GAP_HALFUS / 2
"""The longest pulse and the gap behind it: the longest that neutral waits for the frame that runs."""
WRITING_US = 3
"""From the write of the compare registers to that of the frame's end, at 72 MHz."""
NEUTRAL_US = 1000.0
LATEST_S = 0.01
"""From DISARM to neutral: a line on the UART, and a turn of the loop."""
PHASES = campaign(8, 200)


class Frame(NamedTuple):
    """A frame of pulses as it began; times in us."""

    began_us: float
    pulses_us: tuple[float, ...]


class Seen:
    """Frames that TIM4 begins, and when neutral is written; to be taken off before the machine is restored."""

    def __init__(self, machine: Machine) -> None:
        self.timer, self.frames, self.neutral_us = machine.tim4, list[Frame](), float("inf")
        preload, write = self.timer._preload, self.timer._write_ccr

        def begins() -> None:
            preload()
            pulses = tuple(ccr / 2 for ccr in self.timer.active_ccr[:2])
            self.frames.append(Frame(self.timer.zero_at / TICKS_PER_US, pulses))

        def writes(index: int, value: int) -> None:
            write(index, value)
            if value == 2 * NEUTRAL_US:
                self.neutral_us = min(self.neutral_us, machine.now / TICKS_PER_US)

        vars(self.timer).update(_preload=begins, _write_ccr=writes)

    def remove(self) -> None:
        del vars(self.timer)["_preload"], vars(self.timer)["_write_ccr"]


def around(scene: Scene, after_s: float, inject: Callable[[Scene], object]) -> Seen:
    """The frames around what happens so much later, at least a frame: the one that runs then was seen to begin."""
    seen = Seen(scene.machine)
    begun_s, done = scene.now_s, False
    while scene.now_s < begun_s + after_s + LATEST_S + 3 * FRAME_MAX_US * 1e-6:
        if not done and scene.now_s >= begun_s + after_s:
            inject(scene)
            done = True
        scene.run(LISTEN_S if done else min(LISTEN_S, begun_s + after_s - scene.now_s))
        scene.machine.tim4.settle(scene.machine.now)
    seen.remove()
    return seen


def waited_us(seen: Seen) -> float:
    """From the first neutral that was written to the frame that begins with it; every pulse before is whole."""
    before = [frame for frame in seen.frames if frame.began_us <= seen.neutral_us]
    after = [frame for frame in seen.frames if frame.began_us > seen.neutral_us]
    assert before and after and max(before[-1].pulses_us) > NEUTRAL_US, "the board drove"
    assert all(frame.pulses_us == (NEUTRAL_US, NEUTRAL_US) for frame in after)
    ended_us = after[0].began_us - before[-1].began_us
    assert ended_us >= max(before[-1].pulses_us) + GAP_HALFUS / 2 and ended_us >= FRAME_MIN_US
    return after[0].began_us - seen.neutral_us


@pytest.mark.slow
@pytest.mark.parametrize("frame_us", [FRAME_MIN_US, 2200, 2500, FRAME_MAX_US])
def test_neutral_begins_when_the_pulses_of_the_frame_are_over(frame_us: int) -> None:
    scene = driving("quad", image=IMAGE, changes={"esc_period_us": int(frame_us), "esc.max_halfus": 4000})
    taken, chance = scene.snapshot(), random.Random(frame_us)
    try:
        for _ in range(PHASES):
            seen = around(scene, chance.uniform(1e-6 * frame_us, 3e-6 * frame_us), disarms)
            assert 0 < waited_us(seen) <= min(frame_us, ENDED_US) + WRITING_US
            begun_us = [frame.began_us for frame in seen.frames if frame.began_us > seen.neutral_us]
            assert begun_us[1] - begun_us[0] == pytest.approx(frame_us, abs=0.1), "the usual length again"
            scene.machine.restore(taken)
    finally:
        scene.board.close()


@pytest.mark.slow
def test_a_crash_whose_reset_fails_ends_the_frame_too() -> None:
    scene = driving("quad", image=IMAGE, changes={"esc_period_us": int(FRAME_MAX_US)})
    taken, chance = scene.snapshot(), random.Random(1)
    try:
        for _ in range(PHASES):
            seen = around(scene, chance.uniform(1e-6 * FRAME_MAX_US, 3e-6 * FRAME_MAX_US), crash_without_reset)
            assert 0 < waited_us(seen) <= ENDED_US + WRITING_US
            scene.machine.restore(taken)
    finally:
        scene.board.close()
