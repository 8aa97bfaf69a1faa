"""The words of `phone` stay within what the design says, over the vectors and inputs of plumb.proof.ranges."""

from __future__ import annotations

from plumb.proof import ranges


def test_phones_words_stay_within_what_the_design_says() -> None:
    worst = {row.name: row.worst for row in ranges.used("phone")}
    assert 15.99 < worst["tangent_q26"] <= 16 and 7.99 < worst["roll_rate_turnps_q28"] <= 8, "reached, and held"
    for axis in "xyz":
        assert worst[f"rate_{axis}_turnps_q28"] <= 7 and worst[f"accel_{axis}_g_q26"] <= 28
    assert worst["pitch_measured_turn_q32"] <= 1 / 4
    for axis in ("pitch", "roll"):
        assert worst[f"{axis}_p00"] <= 2**56 and worst[f"{axis}_p11"] <= 2**56 and worst[f"{axis}_variance"] <= 2**24
        assert worst[f"{axis}_k0_q29"] < 1 and worst[f"{axis}_k1_q29"] < 1
        assert worst[f"{axis}_bias_turn_q61"] <= 1 / 8 and worst[f"{axis}_bias_turnps_q28"] <= 1
