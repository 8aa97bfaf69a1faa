"""A pin that is read moves nothing: the board's conversions move the plant, and a source only answers."""

from __future__ import annotations

import pytest

pytest.importorskip("unicorn")

from plumb import systems
from plumb.boards.plant_on_pins import sampling_began_s
from plumb.boards.virtual import VirtualBoard
from plumb.contract.parameters import quantise
from plumb.systems.contracts import PINS, AnalogPins

STEPS = 5


@pytest.mark.parametrize("name", ["quad", "turntable"])
def test_reading_a_pin_leaves_the_plant_where_it_is(name: str) -> None:
    """Read or not, the board takes the same samples at the same times."""
    system, live = systems.load(name), systems.load(name, PINS)
    tuning = system.TUNINGS[live.TUNING]
    with VirtualBoard() as board:
        board.session.upload(quantise(tuning).words(), period_us=tuning.period_us, **system.LINK)
        machine = board.machine
        scenario = system.scenario(live.SHOWN, 1, seconds=1.0, period_us=tuning.period_us)
        coupling = live.couple(machine, system.plant(scenario))
        board.session.begin("REALTIME_LIVE", frames=live.FRAMES)
        machine.advance_us(tuning.period_us * 1.5)
        before = machine.snapshot(coupling, board.session)

        def go_on() -> list[object]:
            machine.advance_us(tuning.period_us * STEPS)
            return list(coupling.taken)

        unread = go_on()
        assert len(unread) >= STEPS
        assert all(conversion.time_s > sampling_began_s(machine) for conversion in coupling.taken)
        machine.restore(before)
        for pin in live.ADC_PINS if isinstance(live, AnalogPins) else ():
            source = machine.adc[pin]
            assert callable(source)
            now_s = machine.now_s
            volts = source(now_s)
            for _ in range(50):  # later, earlier, and again
                source(now_s + 0.5), source(0.0)
            assert source(now_s) == volts
        assert go_on() == unread


@pytest.mark.parametrize("name", ["quad", "turntable"])
def test_a_held_pin_leaves_the_other_pins_to_the_plant(name: str) -> None:
    system, live = systems.load(name), systems.load(name, PINS)
    tuning = system.TUNINGS[live.TUNING]
    assert isinstance(live, AnalogPins)
    with VirtualBoard() as board:
        board.session.upload(quantise(tuning).words(), period_us=tuning.period_us, **system.LINK)
        machine = board.machine
        coupling = live.couple(
            machine, system.plant(system.scenario(live.SHOWN, 1, seconds=1.0, period_us=tuning.period_us))
        )
        board.session.begin("REALTIME_LIVE", frames=live.FRAMES)
        machine.adc[live.ADC_PINS[0]] = 1.5
        seen = set()
        for _ in range(STEPS):
            machine.advance_us(tuning.period_us)
            seen.add(tuple(machine.adc.sampled(pin, machine.now_s) for pin in live.ADC_PINS[1:]))
        assert len(coupling.taken) >= STEPS - 1
        assert len(seen) >= STEPS - 1
        assert machine.adc.sampled(live.ADC_PINS[0], machine.now_s) == 1.5
