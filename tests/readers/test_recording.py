"""Recordings of real sensors become counts of one axis; whatever is wrong with a file is one sentence."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from plumb import __main__ as front
from plumb.contract.parameters import quantise
from plumb.errors import UsageError
from plumb.readers import recording
from plumb.readers.recording import G_MPS2
from plumb.systems.quad.scenarios import TUNINGS
from support.declared_systems import of_declared

HEADED = b"time_s,gx (dps),gy (dps),gz (dps),ax (g),ay (g),az (g)\n"
AXES = ("x", "y", "z")
LEVEL = {"x": (0.0, 0.0, 1.0), "y": (0.0, 0.0, 1.0), "z": (0.0, 1.0, 0.0)}
"""Vertical in sensor coordinates at tilt 0 about each axis."""


def turning(axis: str, seconds: float = 10.0, rate_hz: float = 200.0, jitter_s: float = 0.0) -> dict[str, np.ndarray]:
    """An ideal sensor that turns about one level axis by 60 deg sin(2 t), in closed form."""
    n = round(seconds * rate_hz)
    t = np.arange(n) / rate_hz + jitter_s * np.random.default_rng(3).uniform(-1.0, 1.0, n)
    t -= t[0]
    half = np.radians(60.0) * np.sin(2.0 * t) / 2.0
    i = "xyz".index(axis)
    turn = np.zeros((n, 4))
    turn[:, 0], turn[:, 1 + i] = np.cos(half), np.sin(half)
    # For z the sensor first stands on its side: earth z along sensor y.
    side = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]) if axis == "z" else np.array([1.0, 0.0, 0.0, 0.0])
    quat = np.stack([product(side, row) for row in turn])
    up = recording.vertical(quat)
    gyr = np.zeros((n, 3))
    gyr[:, i] = np.radians(60.0) * 2.0 * np.cos(2.0 * t)
    return {"time_s": t, "gyr": gyr, "acc": up * G_MPS2, "ref_quat": quat, "movement": t > 2.0}


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    w, v = a[0] * b[0] - a[1:] @ b[1:], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([w, *v])


def saved(folder: Path, columns: dict[str, Any]) -> Path:
    path = folder / "run.npz"
    np.savez(path, **columns)
    return path


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("period_us", [2_500, 5_000, 20_000])
@pytest.mark.parametrize("jitter_s", [0.0, 0.002])
def test_turning_about_a_level_axis_is_its_tilt(tmp_path: Path, axis: str, period_us: int, jitter_s: float) -> None:
    loaded = recording.load(saved(tmp_path, turning(axis, jitter_s=jitter_s)))
    one = recording.pick_axis(loaded, axis, period_us)
    gyro, y, z = (
        (one.raw[:, c] - ch.zero_counts) * ch.unit_per_count
        for c, ch in enumerate((one.calibration.gyro, one.calibration.accel, one.calibration.accel_up))
    )
    expected_deg = 60.0 * np.sin(2.0 * one.time_s)
    edge = slice(2, -2)
    # 240 deg/s^2 at most: between samples 9 ms apart a line is wrong by 0.0025 deg, the mean over 20 ms by 0.004, and
    # late by up to the jitter's mean.
    assert np.max(np.abs(one.truth_deg - expected_deg)[edge]) < 0.05
    assert np.max(np.abs(np.degrees(np.arctan2(y, z)) - expected_deg)[edge]) < 0.05
    # 240 deg/s^2 over a mean error in time of up to 0.8 ms.
    assert np.max(np.abs(gyro - 120.0 * np.cos(2.0 * one.time_s))[edge]) < 0.2
    assert np.array_equal(one.scored[one.time_s > 2.01], np.full(np.sum(one.time_s > 2.01), True))
    assert not np.any(one.scored[one.time_s < 1.99]) and not np.any(one.singular)
    assert 30_000 <= np.max(np.abs(one.raw[:, 0])) <= 32_767, "the counts use the range"
    assert one.raw.dtype == np.int16 and not np.any(one.raw[:, 3:])


def test_the_rate_of_tilt_is_the_stated_one_in_general_motion() -> None:
    # tilt' = w_x - u_x (u_y w_y + u_z w_z) / (u_y^2 + u_z^2), from u' = u x w, checked by a difference quotient.
    rng = np.random.default_rng(8)
    for axis, (first, second, sign) in {"x": (1, 2, 1.0), "y": (0, 2, -1.0), "z": (0, 1, 1.0)}.items():
        i = "xyz".index(axis)
        for _ in range(20):
            u, w = rng.standard_normal(3), rng.standard_normal(3)
            u /= np.linalg.norm(u)
            h = 1e-5
            later, earlier = u + h * np.cross(u, w), u - h * np.cross(u, w)
            quotient = np.arctan2(sign * later[first], later[second]) - np.arctan2(
                sign * earlier[first], earlier[second]
            )
            coupling = u[i] * (u[first] * w[first] + u[second] * w[second]) / (u[first] ** 2 + u[second] ** 2)
            # A difference quotient with h = 1e-5: the third derivative is divided by (u_y^2 + u_z^2)^3, small for a
            # few of these.
            assert ((quotient + np.pi) % (2 * np.pi) - np.pi) / (2 * h) == pytest.approx(w[i] - coupling, abs=1e-5)


def test_a_longer_period_takes_the_mean_and_does_not_alias() -> None:
    time_s = np.arange(4001) / 1000.0
    hum = np.sin(2.0 * np.pi * 50.0 * time_s + 1.0)
    slow = 3.0 * time_s
    out = recording.steady(time_s, np.stack([hum, slow], 1), 20_000)
    assert np.max(np.abs(out[1:-1, 0])) < 1e-9, "one whole period of the hum in every mean"
    assert out[1:-1, 1] == pytest.approx(3.0 * 0.02 * np.arange(1, len(out) - 1))


def test_markers_lost_and_a_vertical_axis_are_not_scored(tmp_path: Path) -> None:
    columns = turning("x")
    columns["ref_quat"][800:900] = np.nan
    one = recording.pick_axis(recording.load(saved(tmp_path, columns)), "x", 5_000)
    assert np.all(np.isnan(one.truth_deg[801:899])) and not np.any(one.scored[801:899]) and one.scored[950]
    upright = turning("z")
    standing = recording.pick_axis(
        recording.load(saved(tmp_path, {**upright, "ref_quat": turning("x")["ref_quat"]})), "z"
    )
    flat = np.abs(standing.time_s % (np.pi / 2)) < 0.02
    assert np.all(standing.singular[flat]) and not np.any(standing.scored & standing.singular)


def test_without_reference_nothing_is_scored(tmp_path: Path) -> None:
    columns = turning("y")
    del columns["ref_quat"], columns["movement"]
    one = recording.pick_axis(recording.load(saved(tmp_path, columns)), "y")
    assert one.period_us == 5_000 and np.all(np.isnan(one.truth_deg)) and not np.any(one.scored)


def test_a_sensor_at_rest_is_scaled_no_finer_than_the_firmware_can_carry(tmp_path: Path) -> None:
    columns = turning("x")
    columns["gyr"] = np.zeros_like(columns["gyr"])
    columns["acc"] = np.tile([0.0, 0.0, 9.81], (len(columns["acc"]), 1))
    for axis in AXES:
        one = recording.pick_axis(recording.load(saved(tmp_path, columns)), axis)
        quantise(replace(TUNINGS["recording"], calibration=one.calibration, period_us=one.period_us))


def test_arrays_of_no_concern_are_ignored(tmp_path: Path) -> None:
    columns: dict[str, Any] = {**turning("x"), "subject": np.array("pendulum"), "phase": np.array([1j])}
    assert recording.load(saved(tmp_path, columns)).path.suffix == ".npz"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("lost", [0.0, np.inf, np.nan])
def test_a_reference_without_length_is_lost(tmp_path: Path, lost: float) -> None:
    columns = turning("x")
    columns["ref_quat"][500] = lost
    one = recording.pick_axis(recording.load(saved(tmp_path, columns)), "x")
    assert np.isnan(one.truth_deg[500]) and not one.scored[500] and one.scored[600]


def test_csv_in_either_unit_is_the_same_recording(tmp_path: Path) -> None:
    columns = turning("x", seconds=4.0)
    npz = recording.pick_axis(recording.load(saved(tmp_path, columns)), "x", 5_000)
    for gyr_unit, gyr_factor, acc_unit, acc_factor in (
        ("radps", 1.0, "mps2", 1.0),
        ("dps", 57.29577951308232, "g", 1 / G_MPS2),
    ):
        names = ["time_s", *(f"gyr_{c}_{gyr_unit}" for c in AXES), "note", *(f"acc_{c}_{acc_unit}" for c in AXES)]
        names += [*(f"ref_{c}" for c in "wxyz"), "movement"]
        lines = [",".join(names)]
        for k in range(len(columns["time_s"])):
            row = [columns["time_s"][k], *(columns["gyr"][k] * gyr_factor), "x", *(columns["acc"][k] * acc_factor)]
            row += [*(columns["ref_quat"][k] if k != 500 else [""] * 4), int(columns["movement"][k])]
            lines.append(",".join(str(value) for value in row))
        path = tmp_path / "run.csv"
        path.write_text("\n".join(lines) + "\n")
        one = recording.pick_axis(recording.load(path), "x", 5_000)
        assert np.array_equal(one.raw, npz.raw) and np.isnan(one.truth_deg[500]) and not one.scored[500]
        assert np.array_equal(np.delete(one.scored, 500), np.delete(npz.scored, 500))


def spoiled(change: str) -> dict[str, Any]:
    columns: dict[str, Any] = dict(turning("x"))
    gyr, acc, time_s = columns["gyr"], columns["acc"], columns["time_s"]
    assert isinstance(gyr, np.ndarray) and isinstance(acc, np.ndarray) and isinstance(time_s, np.ndarray)
    match change:
        case "nan":
            gyr[123, 1] = np.nan
        case "infinite":
            acc[77, 0] = np.inf
        case "short":
            columns = {name: value[:100] for name, value in columns.items()}
        case "one sample":
            columns = {name: value[:1] for name, value in columns.items()}
        case "no samples":
            columns = {name: value[:0] for name, value in columns.items()}
        case "no acc":
            del columns["acc"]
        case "no time":
            del columns["time_s"]
        case "rate":
            del columns["time_s"]
            columns["rate_hz"] = 0.0
        case "shape":
            columns["gyr"] = gyr[:, :2]
        case "lengths":
            columns["acc"] = acc[:-1]
        case "reference":
            columns["ref_quat"] = gyr
        case "backwards":
            time_s[100] = time_s[98]
        case "gap":
            time_s[1000:] += 5.0
        case "units":
            columns["gyr"] = gyr * 57.3
        case "objects":
            columns["gyr"] = np.array([None, 1], object)
    return columns


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("nan", "gyr of sample 123"), ("infinite", "acc of sample 77"), ("short", "too short"),
        ("one sample", "too short"), ("no samples", r"not \(N, 3\)|too short"), ("no acc", "lacks acc"),
        ("no time", "time_s or rate_hz"), ("rate", "rate_hz 0"), ("shape", r"not \(N, 3\)"),
        ("lengths", r"not \(N, 3\)"), ("reference", "ref_quat"), ("backwards", "runs back at sample 100"),
        ("gap", "gap of 5.0 s at sample 1000"), ("units", "2500 deg/s or 27.5 g"), ("objects", "plain numbers"),
    ],
)  # fmt: skip
def test_a_bad_recording_is_one_sentence(tmp_path: Path, change: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence) as error:
        recording.load(saved(tmp_path, spoiled(change)))
    assert "\n" not in str(error.value) and error.value.exit_code == 2


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("none.npz", None, "No such file"), ("noise.npz", b"\x00\x01 nothing", "damaged"),
        ("empty.npz", b"", "damaged"),
        ("photo.jpg", b"\xff\xd8", "neither"), ("empty.csv", b"", "empty"), ("binary.csv", b"\xff\xfe\x00", "CSV"),
        ("words.csv", b"time_s,a\n1,2\n", "needs columns"),
        ("text.csv", HEADED + b"soon,2\n", "line 2: 'soon'"),
        ("cut.npz", b"cut", "damaged"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_one_sentence(tmp_path: Path, name: str, content: bytes | None, sentence: str) -> None:
    path = tmp_path / name
    if content == b"cut":
        content = saved(tmp_path, turning("x")).read_bytes()[:2000]
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UsageError, match=sentence) as error:
        recording.load(path)
    assert "\n" not in str(error.value)


def test_wrong_axis_and_period_are_refused(tmp_path: Path) -> None:
    loaded = recording.load(saved(tmp_path, turning("x")))
    with pytest.raises(UsageError, match="x, y or z"):
        recording.pick_axis(loaded, "up")
    with pytest.raises(UsageError, match="100000 us"):
        recording.pick_axis(loaded, "x", 1)


def test_blocks_have_the_mean_and_the_mark_of_their_last_sample(tmp_path: Path) -> None:
    whole = recording.load(saved(tmp_path, turning("x")))
    third = recording.decimated(whole, 3)
    assert len(third.time_s) == len(whole.time_s) // 3 and third.time_s[0] == 0.0
    assert third.step_s == pytest.approx(3 * whole.step_s)
    for block in (0, 7, len(third.time_s) - 1):
        part = slice(3 * block, 3 * block + 3)
        assert third.gyr_dps[block] == pytest.approx(whole.gyr_dps[part].mean(axis=0))
        assert third.acc_g[block] == pytest.approx(whole.acc_g[part].mean(axis=0))
        assert whole.ref_quat is not None and third.ref_quat is not None
        assert np.array_equal(third.ref_quat[block], whole.ref_quat[3 * block + 2])
        assert third.movement[block] == whole.movement[3 * block + 2]
    assert recording.decimated(whole, 1) is whole
    with pytest.raises(UsageError, match="too few for --decimate 6"):
        recording.decimated(replace(whole, time_s=whole.time_s[:11]), 6)


@pytest.mark.parametrize("system", of_declared(["quad", "phone", "attitude"]))
def test_replay_decimates_as_compare_does(tmp_path: Path, system: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Half a second of a sensor of 200 Hz is 100 steps of 5 ms, 33 of 15 ms, 16 of 30 ms."""
    path = saved(tmp_path, turning("x", seconds=4.0))
    steps = []
    sixth = ["--decimate", "6", *(["--period-us", "15000"] if system == "attitude" else [])]  # it cannot have 30 ms
    for more in ([], ["--decimate", "3"], sixth):
        assert front.main(["replay", str(path), "--system", system, "--board", "native", "--json", *more]) == 0
        said = json.loads(capsys.readouterr().out)
        assert said["verdict"] == "pass" and said["proof"] is False
        steps.append(said["steps"])
    assert steps == {"quad": [800, 266, 133], "phone": [399, 397, 396], "attitude": [800, 266, 265]}[system]
    if system == "attitude":
        assert front.main(["replay", str(path), "--system", system, "--board", "native", "--decimate", "6"]) == 2
        assert "a period of 30000 us is outside 1000 to 21000 us; resample with" in capsys.readouterr().err


@pytest.mark.parametrize("system", of_declared(["quad", "phone", "attitude"]))
def test_what_cannot_be_decimated_is_one_sentence(
    tmp_path: Path, system: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Blocks longer than the recording, a gap, and a stamp that runs back; a short gap is part of its block."""
    gyr, acc = np.zeros((11, 3)), np.tile([0.0, 0.0, 9.81], (11, 1))
    even = 0.25 * np.arange(11)
    command = ["replay", str(tmp_path / "run.npz"), "--system", system, "--board", "native"]
    for time_s, block, sentence in (
        (even, "6", "too few for --decimate 6"),
        (np.where(even > 1.0, even + 2.0, even), "3", "has a gap of 2.2 s at sample 5"),
        (np.where(even == 1.0, 0.0, even), "3", "time stands still or runs back"),
    ):
        np.savez(tmp_path / "run.npz", gyr=gyr, acc=acc, time_s=time_s)
        assert front.main([*command, "--decimate", block]) == 2
        said = capsys.readouterr().err
        assert sentence in said and said.count("\n") == 1
    for wrong in ("0", "-3", "2", "1000000", "three"):
        with pytest.raises(SystemExit, match="2"):
            front.main([*command, "--decimate", wrong])
        assert "--decimate" in capsys.readouterr().err
    gappy = np.arange(600) * 0.005
    gappy[300:] += 0.7
    np.savez(tmp_path / "run.npz", gyr=np.zeros((600, 3)), acc=np.tile([0.0, 0.0, 9.81], (600, 1)), time_s=gappy)
    assert front.main([*command, "--decimate", "3", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "pass"


def test_the_program_that_converts_a_recording_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As the how-to page runs it, with the names that the data set's files have."""
    savemat = pytest.importorskip("scipy.io", reason="scipy is not installed: the extra tune").savemat
    angle = np.radians(20.0) * np.sin(2.0 * np.pi * 0.3 * np.arange(1500) * 0.0035)
    zero = np.zeros_like(angle)
    quat = np.stack([np.cos(angle / 2), np.sin(angle / 2), zero, zero], 1)
    quat[40] = np.nan
    fields = {
        "imu_gyr": np.stack([np.gradient(angle, 0.0035), zero, zero], 1),
        "imu_acc": 9.80665 * np.stack([zero, np.sin(angle), np.cos(angle)], 1),
        "imu_mag": np.zeros((1500, 3)),
        "opt_quat": quat,
        "movement": (np.arange(1500) > 300).astype(np.uint8),
        "sampling_rate": 2000 / 7,
    }
    savemat(tmp_path / "trial.mat", fields)
    program = Path(__file__).resolve().parents[2] / "examples" / "recordings" / "from_mat.py"
    command = [sys.executable, str(program), str(tmp_path / "trial.mat"), str(tmp_path / "trial.npz")]
    subprocess.run(command, check=True)
    replayed = ["replay", str(tmp_path / "trial.npz"), "--system", "attitude", "--board", "native", "--json"]
    assert front.main(replayed) == 0
    said = json.loads(capsys.readouterr().out)
    # 1199 samples move; a few at the ends may not be scored.
    assert said["steps"] == 1500 and 1190 <= said["scored_steps"] < 1200
    assert said["metrics"]["angle_rmse_deg"] < 1.0


CSV_HEAD = "ms, gx, gy, gz, ax, ay, az, qw, qx, qy, qz"
CSV_LINES = [f"{10 * k},0,0,0,0,0,1,1,0,0,0" for k in range(400)]
CSV_GAP = [*CSV_LINES[:99], "990,,,,0,0,1,,,,", *CSV_LINES[100:]]


def from_csv(folder: Path, lines: list[str]) -> subprocess.CompletedProcess[str]:
    """Run the program of the how-to on these lines."""
    program = Path(__file__).resolve().parents[2] / "examples" / "recordings" / "from_csv.py"
    (folder / "imu.csv").write_text("\n".join(lines), encoding="utf-8")
    command = [sys.executable, str(program), str(folder / "imu.csv"), str(folder / "imu.npz")]
    return subprocess.run(command, check=False, capture_output=True, text=True)


def test_a_csv_becomes_a_recording_without_its_empty_cells(tmp_path: Path) -> None:
    done = from_csv(tmp_path, [CSV_HEAD, *CSV_GAP])
    assert (done.returncode, done.stdout) == (0, "399 samples, 1 without a value left out\n"), done.stderr
    found = recording.load(tmp_path / "imu.npz")
    assert found.time_s[-1] == pytest.approx(3.99) and np.diff(found.time_s).max() == pytest.approx(0.02)
    assert np.allclose(found.acc_g[0], [0.0, 0.0, 1.0]) and found.ref_quat is not None


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ([CSV_HEAD.replace("gx", "wx"), *CSV_LINES], "has no column gx; it has ms, wx, gy"),
        ([CSV_HEAD, "0,oops,0,0,0,0,1,1,0,0,0"], "line 2: 'oops' in column gx is not a number"),
        ([CSV_HEAD], "has no line of samples below its header"),
        ([CSV_HEAD, "0,,,,,,,,,,"], "has no line with a value in each column"),
    ],
)
def test_a_csv_that_is_not_as_it_was_said_is_refused_in_one_sentence(
    tmp_path: Path, lines: list[str], said: str
) -> None:
    done = from_csv(tmp_path, lines)
    assert done.returncode == 1 and said in done.stderr and done.stderr.count("\n") == 1
    assert not (tmp_path / "imu.npz").exists()


def test_options_of_a_log_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    units = str(saved(tmp_path, turning("x")))
    table = tmp_path / "table.toml"
    table.touch()
    for option in (["--log-run", "1"], ["--params", str(table)]):
        assert front.main(["replay", units, "--board", "native", *option]) == 2
        assert f"{option[0]} is for logs: run.npz is a recording in units" in capsys.readouterr().err


def test_a_replay_of_units_says_that_it_is_no_proof(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["replay", str(saved(tmp_path, turning("x"))), "--board", "native"]) == 0
    said = capsys.readouterr().out
    assert "origin: the counts were made from units, for an ideal sensor: no proof" in said and said.endswith("pass\n")


def test_the_developer_recordings_load_on_every_axis() -> None:
    folder = os.environ.get("PLUMB_DATA")
    if not folder or not Path(folder).is_dir():
        pytest.skip("set PLUMB_DATA to the folder of recordings to run this on real sensors")
    files = sorted(Path(folder).glob("*.npz"))
    assert files, f"no .npz in {folder}"
    for path in files:
        loaded = recording.load(path)
        for axis in AXES:
            one = recording.pick_axis(loaded, axis)
            # The counts use the range: 97 % of 16 bits.
            assert len(one.raw) >= 10_000 and np.max(np.abs(one.raw[:, 0])) >= 31_900
            if loaded.ref_quat is not None and path.name.startswith("broad_02") and axis != "z":
                # Slow rotation without translation: the accelerometer across the axis shows the reference's tilt.
                y, z = (
                    one.raw[:, 1] * one.calibration.accel.unit_per_count,
                    one.raw[:, 2] * one.calibration.accel_up.unit_per_count,
                )
                error = (np.degrees(np.arctan2(y, z)) - one.truth_deg + 180.0) % 360.0 - 180.0
                # A hand accelerates by up to 0.14 g: 8 deg. A wrong axis or sign costs tens.
                assert float(np.sqrt(np.mean(error[one.scored] ** 2))) < 8.0
