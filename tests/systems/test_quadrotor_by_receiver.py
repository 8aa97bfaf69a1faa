"""`quadrotor` flown by a pilot's receiver: samples come over the link, sticks as CRSF on the receiver's line, and the
words of the rotors move the plant; the shipped loop on the native board, in simulated time."""

from __future__ import annotations

import numpy as np
import pytest

from plumb.boards.native.mcu import NativeMcu
from plumb.contract import run_fixed
from plumb.link.realtime import Capture
from plumb.link.sample_codec import layout_of, sample_frames
from plumb.link.selection import RAW_FRAMES
from plumb.link.session import Session
from plumb.spec import crsf
from plumb.systems.quadrotor import quantise, scenarios
from plumb.systems.quadrotor.plant import QuadrotorPlant

PARAMS = quantise.quantise(scenarios.TUNINGS["hummingbird"])
ROTORS = [f"QUADROTOR_ROTOR_{rotor}" for rotor in range(4)]
STATE = "QUADROTOR_STATE"
QUADROTOR = 2
"""BOARD_PINS_QUADROTOR of the firmware."""
LAG_STEPS = 60
"""From a stick to the lean: 0.15 s."""
STOPPED, HELD = 3, 1
AIRBORNE, FLIES, LOST = 1 << 4, 1 << 5, 1 << 7


class ByReceiver:
    """A flight in closed loop. up: the true vertical in body axes at each step; asked: roll and pitch asked for."""

    def __init__(self, name: str, seconds: float) -> None:
        self.scenario = scenarios.scenario(name, 1000, seconds=seconds)
        self.plant = QuadrotorPlant(self.scenario)
        mcu = NativeMcu(power=False)
        mcu.wires.strap, mcu.wires.receiver_byte_ns = QUADROTOR, round(10e9 / crsf.BAUD)
        mcu.power_on()
        self.session = session = Session.open(mcu.uart)
        session.upload(PARAMS.words(), period_us=self.scenario.period_us, receiver=1)
        self.capture = Capture(session, raw_frames=set(RAW_FRAMES[:4]))
        session.begin("REALTIME_INJECTED", frames=[*RAW_FRAMES[:4], *ROTORS, STATE])
        session.listener = self.capture.feed
        layout, pilot = layout_of("quadrotor"), crsf.Pilot()
        self.up: list[list[float]] = []
        self.asked: list[tuple[int, ...]] = []
        for step in range(self.scenario.steps):
            time_s = step * self.scenario.period_us * 1e-6
            self.plant.follow(time_s, self._pulses())
            inputs = self.plant.counts(time_s)
            self.asked.append(inputs[layout.counts : layout.counts + 2])
            mcu.receiver_send(pilot.frames(self.plant.setpoint(time_s), inputs[layout.counts :]))
            session.send(sample_frames(session.protocol, step, inputs[: layout.counts], layout=layout))
            self._pass(self.scenario.period_us * 1e-6)
            self.up.append(self.plant.vehicles.body.matrix[2, :, 0].tolist())
        session.end()

    def _pass(self, seconds: float) -> None:
        end = self.session.clock() + seconds
        while (left := end - self.session.clock()) > 1e-9:
            self.session.receive(left)

    def _pulses(self) -> dict[str, int]:
        """The newest pulses; none before the first step."""
        values = [self.capture.values.get((frame, f"pulse_{rotor}"), {}) for rotor, frame in enumerate(ROTORS)]
        if not all(values):
            return {}
        return {f"pulse_halfus_{rotor}": of[max(of)] for rotor, of in enumerate(values)}

    def state(self, name: str) -> list[int]:
        of = self.capture.values[(STATE, name)]
        return [of[step] for step in sorted(of)]

    def replays(self) -> None:
        steps = min(self.capture.steps, len(self.capture.raw))
        assert steps > 0.95 * self.scenario.steps and self.capture.setpoints.doubt is None
        inputs = np.array([self.capture.raw[step] for step in range(steps)], np.int16)
        words = run_fixed.run_control(PARAMS, inputs, self.capture.setpoints.of_steps(steps))
        assert words.digests().tolist() == [self.capture.digest[step] for step in range(steps)]


def test_a_pilot_flies_by_receiver_and_the_flight_replays_to_the_bit() -> None:
    flight = ByReceiver("sticks", 8.0)
    flags = flight.state("flags")
    assert sum(bool(word & AIRBORNE) for word in flags) * flight.scenario.period_us > 2e6
    assert flags[-1] & FLIES and not any(word & LOST for word in flags)
    air = range(flags.index(next(word for word in flags if word & AIRBORNE)) + 400, len(flags) - LAG_STEPS)
    up = np.array([flight.up[step + LAG_STEPS] for step in air if step + LAG_STEPS < len(flight.up)])
    sticks = np.array([flight.asked[step] for step in air][: len(up)])
    assert 15.0 < np.degrees(np.arccos(up[:, 2].min())) < 50.0, "35 deg are asked for"
    right, forward = np.corrcoef(up[:, 1], sticks[:, 0])[0, 1], np.corrcoef(-up[:, 0], sticks[:, 1])[0, 1]
    assert min(right, forward) > 0.8, "a stick to the right lowers the right side, one to the front the nose"
    flight.replays()


def test_a_receiver_that_is_lost_in_the_air_is_held_then_stopped() -> None:
    flight = ByReceiver("lost", 12.0)
    phases = flight.state("phase")
    first_held, first_stopped = phases.index(HELD), len(phases) - phases[::-1].index(HELD)
    assert phases[first_stopped] == STOPPED and phases[-1] == STOPPED
    held_s = (first_stopped - first_held) * flight.scenario.period_us * 1e-6
    assert held_s == pytest.approx(1.0, abs=0.01)
    assert flight.state("flags")[-1] & LOST and not flight.state("flags")[-1] & FLIES
    flight.replays()
