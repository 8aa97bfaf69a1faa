"""`plumb calibrate` on the whole main loop, held by a hand: what it finds, asks, writes, and puts back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from plumb import __main__ as front
from plumb.boards.held import HeldBoard, open_held
from plumb.boards.link import LinkBoard
from plumb.calibration.axis_calibration import Calibrated, Calibration
from plumb.errors import UsageError, VerdictError
from plumb.link import parameter_table
from plumb.link.session import Session
from plumb.spec.parameter_file import by_name
from plumb.systems.quad.scenarios import scenario
from plumb.systems.wheels import poses as wheels_poses
from plumb.systems.wheels.plant import WheelsPlant
from plumb.tuning.pose_calibration import Pose, Residual
from support.declared_systems import without_part
from support.native_board import UartBoard

SEED = 1003


@pytest.fixture(autouse=True)
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def answers(tmp_path: Path) -> Path:
    path = tmp_path / "answers.toml"
    path.write_text("write = true\nsave = true\n")
    return path


class Clumsy:
    """Holds the board; the first reading of a pose may be another pose."""

    def __init__(self, held: HeldBoard, wrong: dict[str, str]) -> None:
        self.held, self.wrong, self.refusals = held, wrong, list[str]()

    def place(self, pose: Pose) -> None:
        self.held.put(self.wrong.pop(pose.name, pose.name))

    def turn(self, text: str, end: Pose) -> None:
        self.held.put(end.name)

    def refused(self, reason: str) -> None:
        self.refusals.append(reason)


@pytest.mark.slow
def test_wrong_signs_and_scales_are_found_and_a_wrong_pose_is_refused() -> None:
    """The gyro and one axis mounted the other way round, the other axis 10 % off: the result has the signs of the
    plant, and its scales as the seed drew them."""
    held = open_held("native", "quad", SEED)
    with held.board as board:
        right = by_name(parameter_table.read_table(board.session))
        swapped = {name: -right[name] for name in ("gyro.gain", "gyro.offset", "accel_up.gain", "accel_up.offset")}
        accel = {"accel.gain": right["accel.gain"] * 11 // 10, "accel.offset": right["accel.offset"] * 11 // 10}
        parameter_table.commit(board.session, {**right, **swapped, **accel})
        clumsy = Clumsy(held, {"motor 0 up": "level", "upside down": "level"})
        found = Calibration(board.session).run(clumsy)
        assert by_name(parameter_table.read_table(board.session))["gyro.gain"] == -right["gyro.gain"]  # nothing written
    assert [text.partition(":")[0] for text in clumsy.refusals] == ["motor 0 up", "upside down"]
    assert "another pose" in clumsy.refusals[0] and "the same as in the pose 'level'" in clumsy.refusals[1]
    drawn = scenario("quiet", SEED)
    assert sorted(text.partition(" is mounted the other way")[0] for text in found.remarks) == ["accel_up", "gyro"]
    # A turn by 90 deg is measured by the accelerometer, and by a zero that is known to tenths of deg/s over the seconds
    # of the turn: 1 deg of 90, and a half more.
    assert found.words["gyro.gain"] == pytest.approx(right["gyro.gain"] / drawn.scale, rel=0.015)
    # A mean of 100 samples with 8 mg rms of noise is good to 1 mg, 1 count; scale and zero are of two: three times
    # that and more.
    assert found.words["accel.gain"] == pytest.approx(right["accel.gain"], rel=0.005)
    for group, offset_g in zip(("accel", "accel_up"), drawn.offset_g, strict=True):
        zero = -found.words[f"{group}.offset"] / found.words[f"{group}.gain"]
        nominal = -right[f"{group}.offset"] / right[f"{group}.gain"]
        assert zero - nominal == pytest.approx(offset_g * 2**26 / right[f"{group}.gain"], abs=3.0)
    assert found.after.norm_g < 0.005 < found.before.norm_g and found.after.pose_deg < 0.3
    assert abs(found.after.turn_deg) < 2.0 and abs(found.before.turn_deg) > 150.0


def test_a_group_of_two_gyros_is_calibrated_by_the_one_about_the_axle() -> None:
    """The upward gyro of `wheels` has another bias, and feels nothing of the turn."""
    held = open_held("native", "wheels", SEED)
    plant = wheels_poses.held(SEED).plant
    assert isinstance(plant, WheelsPlant)
    with held.board as board:
        found = Calibration(board.session).run(Clumsy(held, {}))
    _, axle_dps, up_dps = plant.imu.bias_now_dps(0.0)[:, 0].tolist()
    zero_dps = -found.words["gyro.offset"] / 2**28 * 360.0
    assert zero_dps == pytest.approx(axle_dps, abs=0.3) and abs(up_dps - axle_dps) > 0.5
    assert found.words["calibrated"] == 1 and abs(found.after.turn_deg) < 2.0


def found_on(calibration: Calibration, _operator: object) -> Calibrated:
    """A result, without its measurements."""
    words = {name: calibration.table[name] + 7 for name in ("gyro.offset", "accel.gain")}
    before, after = Residual(0.01, 2.0, 1.5, -4.0), Residual(0.001, 0.1, 0.0, 0.2)
    return Calibrated(calibration.system, calibration.table, words, before, after, ("gyro is turned",))


def test_the_command_writes_what_it_shows_and_undo_puts_it_back(
    answers: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Calibration, "run", found_on)
    memory = UartBoard()
    memory.run_us(50_000)
    monkeypatch.setattr("plumb.cli.calibrate.opened", lambda _: (LinkBoard("memory", Session.open(memory)), None))
    call = ["calibrate", "--board", "serial:memory", "--answers", str(answers)]

    def table() -> dict[str, int]:
        with Session.open(memory) as session:
            return by_name(parameter_table.read_table(session))

    before = table()
    assert front.main([*call, "--json"]) == 0
    captured = capsys.readouterr()
    said: dict[str, Any] = json.loads(captured.out)
    once = {**before, **{name: change["to"] for name, change in said["changed"].items()}}
    assert captured.err == "in use, and saved\n"
    assert (said["written"], said["saved"], len(said["remarks"]), said["after"]["norm_g"]) == (True, True, 1, 0.001)
    moved = {name: before[name] + 7 for name in ("gyro.offset", "accel.gain")}
    assert table() == once == {**before, **moved}
    assert front.main(call) == 0
    shown = capsys.readouterr().out
    assert "accel.unit_per_count: 0.00100" in shown and " g per count" in shown
    assert "10.00       1.00  mg" in shown and "gyro is turned" in shown
    present = table()
    with Session.open(memory) as session:  # another change in between stays
        parameter_table.commit(session, {**present, "arm_hold_ms": 1234})
    assert front.main([*call, "--undo"]) == 0
    assert table() == {**once, "arm_hold_ms": 1234}
    assert front.main([*call, "--undo", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["left"] == 0
    assert table() == {**before, "arm_hold_ms": 1234}
    assert front.main([*call, "--undo"]) == 2
    assert "nothing to undo" in capsys.readouterr().err
    answers.write_text("write = false\n", encoding="utf-8")
    assert front.main(call) == 1
    assert table() == {**before, "arm_hold_ms": 1234}


def test_answers_that_are_missing_wrong_or_nobodys(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from plumb.cli.questions import Answers, questions

    file = tmp_path / "a.toml"
    file.write_text('write = "yes"\nsystem = "boat"\n')
    asked = Answers(file)
    with pytest.raises(UsageError, match=r"write = 'yes': write true or false"):
        asked.agree("write", "write?", True)
    with pytest.raises(UsageError, match=r"does not answer 'save' \(save it\?\)"):
        asked.agree("save", "save it?", True)
    with pytest.raises(UsageError, match=r"system = 'boat' is none of quad"):
        asked.choose("system", "which?", ["quad"], "quad")
    asked.wait("put it there")
    for _ in range(2):
        asked.refused("it moved")
    with pytest.raises(VerdictError, match="it moved"):
        asked.refused("it moved")
    with pytest.raises(UsageError, match="on a terminal, or give the answers"):
        questions(None)
    for text in ("write = ", "a = " + "[" * 30_000, "a = " + "9" * 5000):
        file.write_text(text)
        assert front.main(["calibrate", "--board", "native", "--answers", str(file)]) == 2
        assert "is no TOML" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--board", "serial:/dev/no-such-port", "--system", "quad"], "--system is for `virtual`"),
    ],
)
def test_wrong_use(arguments: list[str], said: str, answers: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["calibrate", *arguments, "--answers", str(answers)]) == 2
    assert said in capsys.readouterr().err


def test_a_system_without_poses_is_named() -> None:
    name = without_part("poses")
    with pytest.raises(UsageError, match=rf"{name}: no poses are declared"):
        open_held("native", name, SEED)
