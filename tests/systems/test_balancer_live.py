"""`balancer` on the whole flash image: chips on I2C, Hall sensors and bridge, and what comes of parts that fail."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("unicorn")

from plumb import systems
from plumb.boards.plant_on_pins import sampling_began_s
from plumb.boards.virtual import VirtualBoard
from plumb.contract import disturbance
from plumb.contract.parameters import quantise
from plumb.errors import LinkError
from plumb.f103 import Machine
from plumb.proof import live_run
from plumb.proof.runs import Run
from plumb.systems.balancer import pins as balancer_live
from plumb.systems.balancer import scenarios as balancer
from plumb.systems.balancer.drawn_run import GYRO
from plumb.systems.balancer.plant import BalancerPlant
from plumb.systems.balancer.vehicle import EDGE_M
from plumb.systems.contracts import PINS

PARAMS = quantise(balancer.TUNED)


class Watched(balancer_live.BalancerCoupling):
    """Writes down what the firmware reads out of the data registers of the accelerometer."""

    made: list[Watched] = []  # noqa: RUF012

    def __init__(self, machine: Machine, plant: BalancerPlant) -> None:
        super().__init__(machine, plant)
        self.read: list[tuple[float, tuple[int, int, int]]] = []
        self.accel.on_read = lambda _sampled_s, counts: self.read.append((machine.now_s, counts))
        self.made.append(self)


@pytest.fixture(scope="module", params=[pytest.param("serial", marks=pytest.mark.long), "can"])
def inputs(request: pytest.FixtureRequest) -> Iterator[tuple[VirtualBoard, Run]]:
    with VirtualBoard(link=request.param) as board, pytest.MonkeyPatch.context() as patch:
        patch.setattr(balancer_live, "couple", Watched)
        yield board, live_run.run_live(board, balancer.scenario("rough", 1000, seconds=6.0), PARAMS)


def faulty(*texts: str, seconds: float, open_loop: bool = False) -> Run:
    """A live ride with faults, as `plumb run --fault` takes them."""
    asked = balancer.faults([disturbance.parse(text) for text in texts])
    run = balancer.scenario("smooth", 1000, seconds=seconds, faults=asked)
    with VirtualBoard() as board:
        return live_run.run_live(board, run, PARAMS, open_loop=open_loop)


@pytest.mark.slow
def test_an_armed_live_ride_is_the_model_bit_for_bit_and_stays_up(inputs: tuple[VirtualBoard, Run]) -> None:
    board, trial = inputs
    figures = trial.metrics()
    assert trial.verdict == "pass" and figures["target_vs_fixed_mismatches"] == 0
    assert figures["fallen_steps"] == 0
    assert figures["tilt_max_deg"] is not None and 0.2 < figures["tilt_max_deg"] < 5.0
    assert figures["angle_rmse_deg"] is not None and figures["angle_rmse_deg"] < 1.0
    assert not board.machine.warnings


def test_the_chips_and_the_hall_sensors_give_what_the_plant_has(inputs: tuple[VirtualBoard, Run]) -> None:
    """Counts of the registers follow the truth: rate within noise, up about 1 g, edges the way that was rolled."""
    _, trial = inputs
    raw, truth = trial.inputs.raw, trial.inputs.truth
    rate_dps = raw[:, 0] / GYRO.lsb_per_dps - truth["bias_dps"]
    assert np.std(rate_dps - truth["rate_dps"]) < 3 * balancer.GYRO_NOISE_DPS
    assert np.mean(raw[:, 2]) == pytest.approx(256.0, abs=6.0)
    way_m = np.sum(truth["velocity_mps"]) * balancer.PERIOD_US * 1e-6
    assert (int(raw[-1, 3]) - int(raw[0, 3])) * EDGE_M == pytest.approx(way_m, abs=0.02)


def test_every_count_is_what_a_register_held(inputs: tuple[VirtualBoard, Run]) -> None:
    """All three, in order, none left out: gyro about y big-endian, accelerometer x and z little-endian."""
    raw, coupling = inputs[1].inputs.raw, Watched.made[-1]
    begun_s = sampling_began_s(inputs[0].machine)
    gyro = live_run.conversions_of(coupling.taken, begun_s, raw)
    assert [conversion.raw_count for conversion in gyro] == raw[:, 0].tolist()
    accel = np.array([counts for time_s, counts in coupling.read if time_s > begun_s])
    assert np.array_equal(accel[: len(raw)][:, [0, 2]], raw[:, 1:3])
    assert not inputs[0].machine.warnings


def test_the_gyro_has_noise_on_all_axes_but_not_while_it_is_stuck(
    inputs: tuple[VirtualBoard, Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The board takes a chip whose three axes repeat for stuck: quiet axes would make that a matter of chance."""
    coupling = Watched.made[-1]
    times_s = coupling.taken[0].time_s + 1e-3 * np.arange(1000)
    samples = np.array([coupling.gyro.source(time_s) for time_s in times_s])
    assert np.allclose(np.std(samples[:, [0, 2]], axis=0), balancer.GYRO_NOISE_DPS, rtol=0.1)
    stuck = balancer.faults([disturbance.parse("stuck:gyro@0.5-0.8")])
    monkeypatch.setattr(coupling, "plant", BalancerPlant(balancer.scenario("rough", 1000, seconds=6.0, faults=stuck)))
    assert len({coupling.gyro.source(time_s)[::2] for time_s in times_s[600:700]}) == 1


@pytest.mark.slow
def test_faults_on_request_are_in_the_registers_and_at_the_hall_sensors() -> None:
    """Prescribed motion, at rest until 3 s: 200 counts of noise, the end of the scale, nothing, an edge on. The
    accelerometer's faults are shorter than what disarms: three samples at a limit."""
    texts = ["noisy:gyro@1-2", "railed:accel_x@1-1.02", "silent:accel_z@1-1.02", "noisy:hall@1-2"]
    trial = faulty(*texts, seconds=2.8, open_loop=True)
    raw = trial.inputs.raw.astype(int)
    before, during, after = raw[20:95], raw[105:195], raw[205:275]
    assert trial.verdict == "pass"
    assert np.std(during[:, 0]) == pytest.approx(200.0, rel=0.25)
    assert 1 <= np.count_nonzero((raw[:, 1] == 4095) & (raw[:, 2] == 0)) <= 2
    assert np.count_nonzero(np.diff(during[:, 3])) > 20 and np.ptp(during[:, 3]) == 1
    for good in (before, after):
        assert np.std(good[:, 0]) < 12.0 and np.max(np.abs(good[:, 1])) < 40 and np.min(good[:, 2]) > 200
        assert np.ptp(good[:, 3]) == 0, "the wheels stand"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["railed", "silent"])
def test_a_hall_state_that_cannot_be_disarms(kind: str) -> None:
    with pytest.raises(LinkError, match="disarmed itself"):
        faulty(f"{kind}:hall@1", seconds=2.0)


@pytest.mark.slow
def test_a_chip_that_falls_silent_disarms_and_the_vehicle_falls() -> None:
    class Dying(balancer_live.BalancerCoupling):
        def _follow(self, now: int) -> None:
            super()._follow(now)
            self.gyro.answers = self.plant.time_s < 4.0

    with VirtualBoard() as board, pytest.MonkeyPatch.context() as patch:
        patch.setattr(balancer_live, "couple", Dying)
        with pytest.raises(LinkError, match=r"takes no samples|disarmed itself"):
            live_run.run_live(board, balancer.scenario("rough", 1000, seconds=8.0), PARAMS)
        assert not board.machine.bridge().enabled, "no duty on stale samples"


def test_it_is_armed_on_the_pins_of_the_bridge_only() -> None:
    assert balancer.LINK["pins"] == 1 and systems.load("balancer", PINS).FRAMES[-1] == "BALANCER_DRIVE"
    with VirtualBoard() as board:
        board.session.upload(PARAMS.words(), period_us=balancer.PERIOD_US)
        board.session.begin("REALTIME_INJECTED")
        with pytest.raises(LinkError, match="pins"):
            board.session.arm()
