"""plumb.connect: what a board says of itself, its samples, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

import plumb
from support.declared_systems import without_part


@pytest.mark.parametrize("name", ["native", "virtual"])
def test_every_step_of_a_stream_is_a_sample(name: str) -> None:
    with plumb.connect(name, system="quad") as board:
        samples = list(board.stream(0.5))
        first = samples[0].step
        assert first <= 1 and len(samples) == 100
        assert [sample.step - first for sample in samples] == list(range(100))
        assert samples[10].time_s == pytest.approx((first + 10) * 0.005)
        assert {"tilt_deg", "bias_dps", "rate_dps", "pulse_0_us"} <= set(samples[3].signals)
        assert samples[-1].health.mode == "REALTIME" and samples[-1].health.lost_steps == 0
        assert not samples[-1].health.faults and samples[-1].health.blocked
        again = list(board.stream(0.1))
        assert again[0].step > samples[-1].step


def test_a_balancer_comes_up_on_its_own_pins() -> None:
    with plumb.connect("native", system="balancer") as board:
        assert board.params.system == "balancer" and board.params["pins"] == 1
        assert "velocity_mps" in list(board.stream(0.1))[-1].signals


def test_identity() -> None:
    with plumb.connect("native") as board:
        said = board.identity
    assert said.version == plumb.__version__ and "quad" in said.systems and said.mismatch is None


@pytest.mark.parametrize("name", ["nativ", "serial:", "can:x", "", "virtual:1"])
def test_wrong_names_are_refused(name: str) -> None:
    with pytest.raises(plumb.UsageError, match=r"board|bus"):
        plumb.connect(name)


def test_a_port_that_is_not_there_is_link_trouble() -> None:
    with pytest.raises(plumb.LinkError):
        plumb.connect("serial:/dev/there-is-no-such-port")


def test_what_needs_a_link_or_a_plant_says_so() -> None:
    with plumb.connect("fixed") as board, pytest.raises(plumb.UsageError, match="no link"):
        board.arm()
    with pytest.raises(plumb.UsageError, match="there is no system 'quat'"):
        plumb.connect("native", system="quat")
    with pytest.raises(plumb.UsageError, match="a plant"):
        plumb.connect("fixed", system="quad")
    with (
        plumb.connect("native", system=without_part("pins")) as board,
        pytest.raises(plumb.UsageError, match="no sensors of its own"),
    ):
        board.arm()


def test_a_closed_board_says_so() -> None:
    board = plumb.connect("native")
    board.close()
    board.close()
    with pytest.raises(plumb.UsageError, match="closed"):
        _ = board.params


def test_raw_counts_and_samples_of_your_own() -> None:
    """Through the board's own link, and the model: bit for bit."""
    gyr, acc = np.zeros((40, 3)), np.tile([0.0, 1.0, 9.75], (40, 1))
    with plumb.connect("virtual") as board:
        result = board.run("quad", gyr_radps=gyr, acc_mps2=acc)
        assert result.bit_exact and result.steps == 40 and not result.truth and result.accuracy is None
        assert result.metrics == {"target_vs_fixed_mismatches": 0}
        raw = board.run("quad", raw=result.raw[:, :3], period_s=0.02)
        assert (raw.digests == result.digests).all()
    estimate = plumb.Estimator("quad").run(gyr, acc)
    assert (estimate.digests == result.digests).all()


def test_inputs_that_cannot_be_are_refused() -> None:
    with plumb.connect("native") as board:
        with pytest.raises(plumb.UsageError, match="integers"):
            board.run("quad", raw=np.zeros((5, 3)))
        with pytest.raises(plumb.UsageError, match="shape"):
            board.run("quad", raw=np.zeros(5, np.int16))
        with pytest.raises(plumb.UsageError, match="of your own"):
            board.run("quad", scenario="hold", raw=np.zeros((5, 3), np.int16))
        with pytest.raises(plumb.UsageError, match="go with"):
            board.run("quad", period_s=0.01)
        with pytest.raises(plumb.UsageError, match=r"0\.0005"):
            board.run("quad", raw=np.zeros((5, 3), np.int16), period_s=3)
