"""`balancer` on the whole flash image: chips on I2C, Hall sensors and bridge, and what comes of parts that fail."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

pytest.importorskip("unicorn")

from plumb import live, quantise, systems
from plumb.boards.virtual import VirtualBoard
from plumb.errors import LinkError
from plumb.systems import balancer, balancer_live
from plumb.trial import Trial

PARAMS = quantise.quantise(balancer.TUNED)


@pytest.fixture(scope="module")
def flight() -> Iterator[tuple[VirtualBoard, Trial]]:
    with VirtualBoard() as board:
        yield board, live.fly(board, balancer.scenario("rough", 1000, seconds=6.0), PARAMS)


def test_an_armed_live_ride_is_the_model_bit_for_bit_and_stays_up(flight: tuple[VirtualBoard, Trial]) -> None:
    board, trial = flight
    figures = trial.metrics()
    assert trial.verdict == "pass" and figures["target_vs_fixed_mismatches"] == 0
    assert figures["fallen_steps"] == 0
    assert figures["tilt_max_deg"] is not None and 0.2 < figures["tilt_max_deg"] < 5.0
    assert figures["angle_rmse_deg"] is not None and figures["angle_rmse_deg"] < 1.0
    assert not board.machine.warnings


def test_the_chips_and_the_hall_sensors_give_what_the_plant_has(flight: tuple[VirtualBoard, Trial]) -> None:
    """Counts of the registers follow the truth: rate within noise, up about 1 g, edges the way that was rolled."""
    _, trial = flight
    raw, truth = trial.flight.raw, trial.flight.truth
    rate_dps = raw[:, 0] / balancer.GYRO.lsb_per_dps - truth["bias_dps"]
    assert np.std(rate_dps - truth["rate_dps"]) < 3 * balancer.GYRO_NOISE_DPS
    assert np.mean(raw[:, 2]) == pytest.approx(256.0, abs=6.0)
    way_m = np.sum(truth["velocity_mps"]) * balancer.PERIOD_US * 1e-6
    assert (int(raw[-1, 3]) - int(raw[0, 3])) * balancer.EDGE_M == pytest.approx(way_m, abs=0.02)


def test_a_chip_that_falls_silent_disarms_and_the_vehicle_falls() -> None:
    class Dying(balancer_live.Coupling):
        def _follow(self, now: int) -> None:
            super()._follow(now)
            self.gyro.answers = self.plant.time_s < 4.0

    with VirtualBoard() as board, pytest.MonkeyPatch.context() as patch:
        patch.setattr(balancer_live, "Coupling", Dying)
        with pytest.raises(LinkError, match=r"takes no samples|disarmed itself"):
            live.fly(board, balancer.scenario("rough", 1000, seconds=8.0), PARAMS)
        assert not board.machine.bridge().enabled, "no duty on stale samples"


def test_it_is_armed_on_the_pins_of_the_bridge_only() -> None:
    assert balancer.LINK["pins"] == 1 and systems.load("balancer", "live").FRAMES[-1] == "DRIVE"
    with VirtualBoard() as board:
        board.session.upload(PARAMS.words(), period_us=balancer.PERIOD_US)
        board.session.begin("REALTIME_INJECTED")
        with pytest.raises(LinkError, match="pins"):
            board.session.arm()
