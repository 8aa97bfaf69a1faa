"""The attitude loop: responses against closed forms and the reference kernels, the plant found again, margins kept."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from plumb.analyses.identification import loop_test, pid_design, pid_tuning, plant_fit, tested_loop
from plumb.analyses.identification.pid_design import Wanted
from plumb.boards.native.board import NativeBoard
from plumb.contract.parameters import quantise
from plumb.errors import LinkError, UsageError
from plumb.kernels.reference.kernels import PidState, kalman_init, kalman_step, pid_step
from plumb.link.realtime import Capture
from plumb.spec.tuning import RateChoice, Start
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.quad import plant as quad_plant
from plumb.systems.quad import scenarios as quad
from plumb.systems.quad.pins import ESC_PINS
from plumb.tuning import loop_model
from plumb.tuning.loop_model import Controller, Loop, PlantModel

pytest.importorskip("scipy", reason="scipy is not installed: the extra tune")

TUNING = quad.ADAPTIVE
TRUE = PlantModel(
    math.degrees(0.8 * quad_plant.ARM_M * quad_plant.THRUST_N / quad_plant.INERTIA_KGM2),
    quad_plant.MOTOR_TAU_S,
    0.0,
    quad_plant.FRICTION_NMS / quad_plant.INERTIA_KGM2,
)
"""The simulated axis: with pulses around 1500 us its torque is linear in the command, 0.8 of the thrust at 1."""


def test_sampled_plant_is_the_closed_form_of_a_held_command() -> None:
    """gain / (s + d) behind a hold: gain (1 - e^-dT) / d / (z - e^-dT)."""
    hz, period_s, damping = np.geomspace(0.1, 20.0, 30), 0.02, 3.0
    rate, _ = PlantModel(100.0, 1e-9, 0.0, damping).sampled(hz, period_s)
    z, decay = np.exp(2j * np.pi * hz * period_s), math.exp(-damping * period_s)
    expected = 100.0 * (1.0 - decay) / damping / (z - decay)
    assert np.max(np.abs(rate / expected - 1.0)) < 0.05  # what the aliases beyond the fourth add
    late, _ = PlantModel(100.0, 0.05, period_s, damping).sampled(hz, period_s)
    prompt, _ = PlantModel(100.0, 0.05, 0.0, damping).sampled(hz, period_s)
    assert late == pytest.approx(prompt / z)


@pytest.mark.parametrize("rate_choice", ["previous", "current"])
def test_controller_responds_as_the_reference_kernels(rate_choice: RateChoice) -> None:
    """A tilt that swings, through kalman_step and pid_step until all transients are gone."""
    tuning = replace(TUNING, kalman=replace(TUNING.kalman, q_bias_dps2_per_s=0.05, rate=rate_choice))
    cycles, samples, r_deg2 = 8, 64, 0.5
    hz = np.array([1.0 / (samples * tuning.period_s)])
    controller = Controller(tuning, r_deg2)
    tilt, rate = 1.0 + 0j, 2j * math.pi * hz[0]
    estimated, corrected = controller.estimate(hz, np.array([rate]), np.array([tilt]))
    expected = -controller.command(hz, estimated, corrected, tuning.pid)[0]
    state, pid = kalman_init(Start(0.0, 0.0, 0.5, 0.0, 1.0)), PidState()
    settings = replace(tuning.pid, slew_per_s=1e9)
    commands = []
    for step in range(40 * cycles * samples):
        turn = np.exp(2j * math.pi * step / samples) * 0.1
        kalman_step(state, tuning.kalman, tuning.period_s, float((tilt * turn).real), float((rate * turn).real), r_deg2)
        pid_step(pid, settings, tuning.period_s, -state.tilt_deg, float((rate * turn).real) - state.bias_dps)
        commands.append(pid.command)
    last = np.array(commands[-cycles * samples :])
    found = np.fft.rfft(last)[cycles] / (len(last) / 2.0) / 0.1
    assert found == pytest.approx(expected, rel=0.01)


def test_margins_of_a_loop_with_known_ones() -> None:
    """1 / (s (s + 1)^2): phase margin 21.39 deg at 0.6823 rad/s, gain margin 2."""
    hz = np.geomspace(1e-3, 10.0, 4000)
    s = np.asarray(2j * np.pi * hz, np.complex128)
    found = loop_model.margins(hz, 1.0 / (s * (s + 1.0) ** 2))
    assert found.stable and found.gain_db == pytest.approx(6.0206, abs=0.01) and found.lower_gain_db == math.inf
    assert found.phase_deg == pytest.approx(21.386, abs=0.05)
    assert 2.0 * math.pi * found.crossover_hz == pytest.approx(0.6823, abs=1e-3)
    assert found.delay_s == pytest.approx(math.radians(21.386) / 0.6823, rel=0.01)
    assert not loop_model.margins(hz, 3.0 / (s * (s + 1.0) ** 2)).stable


def test_the_shipped_gains_and_a_sample_of_delay() -> None:
    """quad's loop is stable as it is and not with one more step of delay, as its closed loop shows."""
    now = Loop(TRUE, Controller(TUNING, 0.5)).margins(TUNING.pid)
    later = Loop(replace(TRUE, delay_s=0.02), Controller(TUNING, 0.5)).margins(TUNING.pid)
    assert now.stable and 15.0 < now.phase_deg < 25.0 and not later.stable
    assert now.delay_s < 0.02


@pytest.fixture(scope="module")
def tested() -> loop_test.LoopRun:
    params = quantise(TUNING)
    excited = plant_fit.excitation(TUNING.period_s, 4.0)
    with NativeBoard() as board:
        return loop_test.on_twin(board, params, excited, 6, 1000)


def test_plant_of_the_twin_is_found_within_its_confidence(tested: loop_test.LoopRun) -> None:
    found = plant_fit.fit(tested.measurement())
    for name in ("gain_dps2", "lag_s", "damping_per_s"):
        figure = found.figures[name]
        assert figure.low <= getattr(TRUE, name) <= figure.high, name
    assert found.figures["delay_s"].high < 0.004 and found.mismatch < 2.0
    assert found.figures["gain_dps2"].high / found.figures["gain_dps2"].low < 1.25


def test_lines_that_only_a_disturbance_moves_are_left_out() -> None:
    """The slow lines of a loop with a small gain: gusts move command and rate together, and their ratio is that of the
    controller."""
    excited = plant_fit.excitation(quad.HOLD.period_s, 4.0)
    with NativeBoard() as board:
        run = loop_test.on_twin(board, quantise(quad.HOLD), excited, 6, 1000)
    found = plant_fit.fit(run.measurement())
    assert found.response.hz[0] > 1.0
    assert found.plant.gain_dps2 == pytest.approx(TRUE.gain_dps2, rel=0.2) and found.plant.damping_per_s < 3.0
    margins = Loop(found.plant, Controller(quad.HOLD, 1.0)).margins(quad.HOLD.pid)
    assert 36.0 < margins.phase_deg < 43.0


def test_steps_of_the_setpoint_determine_gain_and_lag_too() -> None:
    excited = plant_fit.excitation(quad.HOLD.period_s, 6.0, plant_fit.STEP)
    assert set(np.unique(excited.setpoint_deg)) == {-6.0, 6.0} and all(line % 2 for line in excited.lines.tolist())
    with NativeBoard() as board:
        run = loop_test.on_twin(board, quantise(quad.HOLD), excited, 5, 1000)
    found = plant_fit.fit(run.measurement())
    assert found.plant.gain_dps2 == pytest.approx(TRUE.gain_dps2, rel=0.2)
    # Steps of the setpoint have little at the lag's corner: three periods of 5 ms.
    assert found.plant.lag_s == pytest.approx(TRUE.lag_s, abs=0.015) and found.plant.delay_s < 0.01
    assert found.mismatch < 2.0


def test_gains_have_the_margins_and_the_loop_shows_them(tested: loop_test.LoopRun) -> None:
    wanted = Wanted(35.0, 6.0, 0.02)
    tuning = pid_tuning.tune(tested, wanted)
    assert tuning.before.phase_deg < 25.0 and not tuning.refusal()
    assert isinstance(tuning.loop.controller, Controller)
    true = Loop(TRUE, Controller(TUNING, tuning.loop.controller.r_deg2)).margins(tuning.design.gains)
    assert true.stable and true.phase_deg > 32.0 and true.gain_db > 5.5 and true.delay_s > 0.018
    assert set(tuning.faster) == {10_000, 5_000} and all(one.met for one in tuning.faster.values())
    assert tuning.faster[5_000].rejection_db < 0.0  # against the gains for 20 ms


def test_margins_that_no_gains_have_are_refused(tested: loop_test.LoopRun) -> None:
    loop = Loop(replace(TRUE, delay_s=0.2), Controller(TUNING, 0.5))
    assert not pid_design.design(loop, TUNING.pid, Wanted(75.0, 12.0, 0.3), pid_design.PidSearch()).met


def test_a_test_that_saturates_or_says_nothing_is_refused(tested: loop_test.LoopRun) -> None:
    measured = tested.measurement()
    rng = np.random.default_rng(1)
    noise = replace(measured, rate_dps=rng.standard_normal(measured.rate_dps.shape))
    with pytest.raises(UsageError, match="does not rise above the noise"):
        plant_fit.fit(noise)
    with pytest.raises(UsageError, match="turns the machine the wrong way"):
        plant_fit.fit(replace(measured, rate_dps=-measured.rate_dps))
    loud = replace(tested, setpoint=(40 * tested.setpoint.astype(np.int64)).clip(-(2**30), 2**30).astype(np.int32))
    with pytest.raises(UsageError, match="reaches its limit"):
        loud.measurement()


def test_a_system_that_holds_no_tilt_is_refused() -> None:
    with pytest.raises(UsageError, match="balancer holds no tilt"):
        tested_loop.loop_of(quantise(balancer.TUNINGS[balancer.DEFAULT_TUNING]))


@pytest.mark.slow
def test_the_flash_image_is_tested_armed_and_ends_disarmed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Real time on the simulated chip, a short signal: every step equals the model, and the plant is that of the
    twin."""
    from plumb.boards.virtual import VirtualBoard

    monkeypatch.setattr(plant_fit, "REPEAT_S", 1.0)
    params, excited = quantise(TUNING), plant_fit.excitation(TUNING.period_s, 4.0)
    with VirtualBoard() as board:
        loop_test.attach_plant(board, params, excited, 3, 1000)
        run = loop_test.on_link(board, params, excited, 3, 3.5)
        assert board.session.connect()["MODE"] == 0
        monkeypatch.setattr(loop_test, "TILT_LIMIT_DEG", 0.5)
        loop_test.attach_plant(board, params, excited, 3, 1000)
        with pytest.raises(LinkError, match="the test is ended, disarmed"):
            loop_test.on_link(board, params, excited, 3, 3.5)
        assert board.session.connect()["MODE"] == 0
    found = plant_fit.fit(run.measurement()).figures["gain_dps2"]
    assert found.low <= 1.1 * TRUE.gain_dps2 and found.high >= 0.9 * TRUE.gain_dps2


@pytest.mark.slow
def test_a_board_slower_than_real_time_is_reported_and_ends_disarmed(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock of the host that goes twice as fast as the board's: half of real time."""
    from plumb.boards.virtual import VirtualBoard

    monkeypatch.setattr(plant_fit, "REPEAT_S", 1.0)
    params, excited = quantise(TUNING), plant_fit.excitation(TUNING.period_s, 4.0)
    with VirtualBoard() as board:
        loop_test.attach_plant(board, params, excited, 3, 1000)
        boards_clock = board.session.clock
        board.session.clock = lambda: 2.0 * boards_clock()
        with pytest.raises(
            LinkError, match=r"the board runs at (49|50|51) % of real time: the test is ended, disarmed"
        ):
            loop_test.on_link(board, params, excited, 3, 1.0)
        board.session.clock = boards_clock
        assert board.session.connect()["MODE"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("link", ["serial", "can"])
def test_ctrl_c_in_the_test_disarms(link: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Armed and driving one moment; the motors off the next, long before the keep-alive would have run out."""
    from plumb.boards.virtual import VirtualBoard

    params, excited = quantise(quad.HOLD), plant_fit.excitation(quad.HOLD.period_s, 8.0)
    sent = 0

    def interrupted(capture: Capture, setpoint: int) -> None:
        nonlocal sent
        sent += 1
        if sent > 20:
            assert driving(), "the test had not begun"
            raise KeyboardInterrupt

    monkeypatch.setattr(Capture, "set_setpoint", interrupted)
    with VirtualBoard(link=link) as board:
        loop_test.attach_plant(board, params, excited, 3, 1000)

        def driving() -> bool:
            return board.machine.pwm(ESC_PINS[0]).pulse_us > 1100.0

        with pytest.raises(KeyboardInterrupt):
            loop_test.on_link(board, params, excited, 3, 0.2)
        begun_us = board.machine.now_us
        board.machine.advance_us(6000)
        assert not driving() and board.machine.now_us - begun_us < 20_000
        assert board.session.connect()["MODE"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("link", ["serial", "can"])
def test_a_host_that_is_suspended_in_the_test_ends_disarmed_and_says_so(
    link: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Armed and driving one moment; then this process does not run for a second, in which the board waits for it."""
    from plumb.boards.virtual import VirtualBoard

    params, excited = quantise(quad.HOLD), plant_fit.excitation(quad.HOLD.period_s, 8.0)
    set_setpoint, sent = Capture.set_setpoint, 0

    def suspended(capture: Capture, setpoint: int) -> None:
        nonlocal sent
        sent += 1
        if sent == 20:
            assert driving(), "the test had not begun"
            board.machine.advance_us(1_000_000)
        set_setpoint(capture, setpoint)

    monkeypatch.setattr(Capture, "set_setpoint", suspended)
    with VirtualBoard(link=link) as board:
        loop_test.attach_plant(board, params, excited, 3, 1000)

        def driving() -> bool:
            return board.machine.pwm(ESC_PINS[0]).pulse_us > 1100.0

        with pytest.raises(LinkError, match=r"the keep-alive was lost, as this computer left the link unread for 1\.0"):
            loop_test.on_link(board, params, excited, 3, 0.2)
        assert not driving() and board.session.connect()["MODE"] == 0


@pytest.mark.slow
def test_what_is_slow_the_first_time_is_done_before_the_board_is_armed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first keep-alive value expires 40 ms after its issue; tables and progress bar take longer to make."""
    from plumb.boards.virtual import VirtualBoard

    monkeypatch.setattr(plant_fit, "REPEAT_S", 1.0)
    params, excited = quantise(TUNING), plant_fit.excitation(TUNING.period_s, 4.0)
    made = []
    with VirtualBoard() as board:
        for name in ("signals", "_progress"):
            make = getattr(loop_test, name)

            def first(of: object, make: Callable[[object], object] = make, name: str = name) -> object:
                made.append((name, board.session.armed))
                return make(of)

            monkeypatch.setattr(loop_test, name, first)
        monkeypatch.setattr(loop_test, "TILT_LIMIT_DEG", 0.0)
        loop_test.attach_plant(board, params, excited, 3, 1000)
        with pytest.raises(LinkError, match="the test is ended, disarmed"):
            loop_test.on_link(board, params, excited, 3, 0.2)
    assert made == [("signals", False), ("_progress", False)]
