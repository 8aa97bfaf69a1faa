"""`plumb estimate`: the columns are the angles of the motion in degrees, whatever system makes them."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest

from plumb import __main__ as front
from plumb.analyses.comparison import published
from plumb.analyses.estimation import verticals
from plumb.analyses.estimation.estimated import Estimated, estimate
from plumb.errors import UsageError
from plumb.readers import recording
from plumb.readers.replay import ReplayRequest
from plumb.spec.arrays import FloatArray

PERIOD_S, REST_S, TURN_S, RATE_DPS = 0.01, 8.0, 3.0, 30.0
BIAS_DPS = 0.5


def leaning(roll_deg: float, pitch_deg: float) -> tuple[float, float, float]:
    """The vertical in the axes of a body with this roll and pitch."""
    roll, pitch = math.radians(roll_deg), math.radians(pitch_deg)
    return -math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll)


def turned(path: Path, roll_deg: float, pitch_deg: float, heading_deg: float = 0.0, reference: bool = False) -> Path:
    """A body that rests in this attitude, turns about the vertical, and rests again; the gyro has a bias."""
    steps, rests = round((2 * REST_S + TURN_S) / PERIOD_S), round(REST_S / PERIOD_S)
    up = np.tile(leaning(roll_deg, pitch_deg), (steps, 1))
    rate = np.zeros((steps, 1))
    rate[rests : steps - rests] = RATE_DPS
    rows = np.hstack([np.arange(steps)[:, None] * PERIOD_S, up * rate + BIAS_DPS, up])
    names = ["time_s", *(f"gyr_{axis}_dps" for axis in "xyz"), *(f"acc_{axis}_g" for axis in "xyz")]
    if reference:
        names += [f"ref_{part}" for part in "wxyz"]
        quaternion = of_angles(roll_deg, pitch_deg, heading_deg)
        rows = np.hstack([rows, np.tile(quaternion, (steps, 1))])
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.9f")
    return path


def of_angles(roll_deg: float, pitch_deg: float, heading_deg: float) -> FloatArray:
    """Quaternion w, x, y, z from body to earth."""
    halves = [math.radians(angle) / 2.0 for angle in (roll_deg, pitch_deg, heading_deg)]
    (cr, cp, cy), (sr, sp, sy) = ([f(half) for half in halves] for f in (math.cos, math.sin))
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def made_by(path: Path, system: str = "attitude", axis: str = "x") -> Estimated:
    return estimate(system, ReplayRequest(path, axis))


@pytest.mark.parametrize("seed", range(6))
def test_roll_and_pitch_are_those_of_the_body_at_any_heading(seed: int) -> None:
    rng = np.random.default_rng([seed, 71])
    roll, pitch, heading = rng.uniform(-180, 180), rng.uniform(-89, 89), rng.uniform(-180, 180)
    up = recording.vertical(of_angles(roll, pitch, heading)[None])
    assert verticals.roll_deg(up) == pytest.approx([roll]) and verticals.pitch_deg(up) == pytest.approx([pitch])


def test_verticals_are_apart_by_the_angle_between_them() -> None:
    level, leant = np.array([[0.0, 0.0, 1.0]]), 3.0 * np.array([leaning(0.0, 1e-4)])
    assert verticals.apart_deg(level, leant) == pytest.approx([1e-4], rel=1e-6)
    assert verticals.apart_deg(level, -level) == pytest.approx([180.0])
    assert np.isnan(verticals.apart_deg(level, np.full((1, 3), np.nan))).all()


@pytest.mark.parametrize(("roll", "pitch"), [(20.0, -10.0), (-70.0, 35.0), (170.0, 5.0)])
def test_attitude_gives_the_angles_of_the_motion(tmp_path: Path, roll: float, pitch: float) -> None:
    made = made_by(turned(tmp_path / "turn.csv", roll, pitch))
    middle, last = round((REST_S + TURN_S / 2) / PERIOD_S), -1
    assert made.columns["roll_deg"][last] == pytest.approx(roll, abs=0.1)
    assert made.columns["pitch_deg"][last] == pytest.approx(pitch, abs=0.1)
    assert made.columns["yaw_rate_dps"][middle] == pytest.approx(RATE_DPS, abs=0.2)
    before = made.columns["heading_deg"][round(REST_S / PERIOD_S) - 1]
    assert (made.columns["heading_deg"][last] - before) % 360.0 == pytest.approx(RATE_DPS * TURN_S, abs=0.5)
    assert [made.columns[f"bias_{axis}_dps"][last] for axis in "xyz"] == pytest.approx([BIAS_DPS] * 3, abs=0.05)
    assert 0.0 < made.columns["sigma_deg"][last] < 1.0


@pytest.mark.parametrize(("axis", "roll", "pitch"), [("x", 25.0, 0.0), ("y", 0.0, 25.0)])
def test_one_axis_has_the_sign_of_roll_and_pitch(tmp_path: Path, axis: str, roll: float, pitch: float) -> None:
    made = made_by(turned(tmp_path / "turn.csv", roll, pitch), "quad", axis)
    assert made.columns[f"tilt_{axis}_deg"][-1] == pytest.approx(25.0, abs=0.1)
    assert made.columns["sigma_deg"][-1] > 0.0


def test_phone_gives_roll_and_pitch_with_a_sigma_each(tmp_path: Path) -> None:
    columns = made_by(turned(tmp_path / "turn.csv", 12.0, -7.0), "phone").columns
    assert [columns[name][-1] for name in ("roll_deg", "pitch_deg")] == pytest.approx([12.0, -7.0], abs=0.3)
    assert min(columns[f"{angle}_sigma_deg"][-1] for angle in ("roll", "pitch")) > 0.0


def test_vqf_and_the_reference_stand_next_to_it(tmp_path: Path) -> None:
    pytest.importorskip("vqf")
    columns = made_by(turned(tmp_path / "turn.csv", 15.0, 5.0, 40.0, reference=True)).columns
    for other in ("vqf", "reference"):
        assert columns[f"{other}_roll_deg"][-1] == pytest.approx(15.0, abs=0.1)
        assert columns[f"{other}_pitch_deg"][-1] == pytest.approx(5.0, abs=0.1)
        assert columns[f"{other}_apart_deg"][-1] < 0.1


def test_without_vqf_there_are_the_systems_own_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_one: published.Published) -> None:
        raise UsageError("vqf is not installed")

    monkeypatch.setattr(published, "imported", missing)
    columns = made_by(turned(tmp_path / "turn.csv", 15.0, 5.0)).columns
    assert not [name for name in columns if name.startswith(("vqf", "reference"))] and "roll_deg" in columns


def test_the_command_writes_degrees_flags_by_name_and_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = turned(tmp_path / "turn.csv", 20.0, -10.0), tmp_path / "out"
    assert front.main(["estimate", str(file), "--out", str(out)]) == 0
    with (out / "angles.csv").open(newline="") as text:
        rows = list(csv.DictReader(text))
    assert len(rows) == round((2 * REST_S + TURN_S) / PERIOD_S)
    assert list(rows[0])[:4] == ["time_s", "roll_deg", "pitch_deg", "heading_deg"] and list(rows[0])[-1] == "flags"
    assert "ALIGNING" in rows[0]["flags"].split() and "q30" not in (out / "angles.csv").read_text()[:500]
    assert float(rows[-1]["roll_deg"]) == pytest.approx(20.0, abs=0.1)
    page = (out / "report.html").read_text()
    assert "Angles of turn.csv" in page and "by attitude" in page
    assert str(out / "angles.csv") in capsys.readouterr().out


def test_the_command_prints_figures_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = turned(tmp_path / "turn.csv", 20.0, -10.0)
    assert front.main(["estimate", str(file), "--system", "quad", "--axis", "x", "--json", "--seconds", "7"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["system"], told["steps"], told["period_us"]) == ("quad", 700, 10000)
    assert told["columns"]["tilt_x_deg"]["max"] == pytest.approx(20.0, abs=0.5)


def test_a_missing_file_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["estimate", "none.csv"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("plumb: ") and "none.csv" in said and said.count("\n") == 1
