"""`plumb params` diff, edit, undo and profiles: what is kept on this computer, and what comes back from an editor."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path

import pytest

from plumb import systems
from plumb.files import places
from plumb.link import parameter_history
from plumb.spec import parameters
from support.declared_systems import without_outputs
from support.native_board import UartBoard
from support.params_command import in_use, params

OTHER = [*(name for name in systems.SYSTEMS if name != "quad"), *without_outputs()][-1]
"""A system that the board is not; one that leaves the wiring as it is where there is one."""

DEFAULTS = {row.name: row.default for row in parameters.table()}
Capture = pytest.CaptureFixture[str]


def history() -> Path:
    (file,) = (places.state_folder() / "parameters").glob("*.jsonl")
    return file


@pytest.fixture
def editing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A program that stands for the user's editor; a test writes its source, which edits `text`."""
    program = tmp_path / "editor.py"
    monkeypatch.setenv("VISUAL", shlex.join([sys.executable, str(program)]))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return program


def edits(program: Path, how: str) -> None:
    program.write_text(
        "import pathlib, sys\nfile = pathlib.Path(sys.argv[1])\ntext = file.read_text()\n"
        f"{how}\nfile.write_text(text)\n",
        encoding="utf-8",
    )


# ---- undo ----


def test_undo_goes_back_one_change_after_the_other(board: UartBoard, capsys: Capture) -> None:
    params(capsys, "set", "pid.kp=0.05")
    once = in_use(board)
    params(capsys, "tuning", "balancer")
    params(capsys, "set", "--raw", "pid.kp_q22=7")
    assert params(capsys, "undo")[0] == 0 and params(capsys, "undo")[0] == 0
    assert in_use(board) == once
    code, out, _ = params(capsys, "undo")
    assert code == 0 and "pid.kp: 0.05 -> 0.045 1/deg" in out and in_use(board) == DEFAULTS
    code, out, err = params(capsys, "undo")
    assert code == 2 and out == "" and "nothing to undo: no change" in err


def test_what_another_computer_changed_is_not_undone(board: UartBoard, capsys: Capture) -> None:
    params(capsys, "set", "pid.kp=0.05")
    kept = history().read_text()
    params(capsys, "set", "pid.kp=0.06")
    history().write_text(kept)  # as if that had been set from elsewhere
    before = in_use(board)
    code, _, err = params(capsys, "undo")
    assert code == 2 and "are not what a change from here left" in err and in_use(board) == before


def test_undo_takes_back_a_reset_and_a_file(board: UartBoard, capsys: Capture, tmp_path: Path) -> None:
    params(capsys, "set", "pid.kp=0.05")
    params(capsys, "dump", str(tmp_path / "a.toml"))
    before = in_use(board)
    for arguments in (["reset"], ["load", str(tmp_path / "a.toml")]):
        params(capsys, *arguments)
    assert params(capsys, "undo")[0] == 0 and in_use(board) == DEFAULTS
    assert params(capsys, "undo")[0] == 0 and in_use(board) == before


def test_the_changes_are_listed(board: UartBoard, capsys: Capture) -> None:
    params(capsys, "set", "pid.kp=0.05", "arm_hold_ms=5")
    params(capsys, "set", "pid.kp=0.05")  # changes nothing
    _, out, _ = params(capsys, "undo", "--list")
    assert len(out.splitlines()) == 1 and out.rstrip().endswith("set pid.kp=0.05 arm_hold_ms=5  (2 integers)")
    _, out, _ = params(capsys, "undo", "--list", "--json")
    assert json.loads(out)["changes"][0]["before"] == {"pid.kp_q22": 67947725, "arm_hold_ms": 1000}


@pytest.mark.parametrize(
    "damage",
    ["not json\n", "[]\n", '{"time": 1}\n', "null\n", '{"before": {}}\n', "[" * 5000 + "\n"],
)
def test_a_damaged_line_is_left_out(board: UartBoard, capsys: Capture, damage: str) -> None:
    params(capsys, "set", "pid.kp=0.05")
    history().write_text(damage + history().read_text() + damage)
    assert params(capsys, "undo")[0] == 0
    assert in_use(board) == DEFAULTS


@pytest.mark.parametrize("field", ["before", "after"])
@pytest.mark.parametrize("value", [{"pid.kp_q22": "7"}, {"pid.kp_q22": True}, {"no.such": 7}, 7, None])
def test_a_change_with_wrong_values_is_none(board: UartBoard, capsys: Capture, field: str, value: object) -> None:
    params(capsys, "set", "pid.kp=0.05")
    history().write_text(json.dumps({**json.loads(history().read_text()), field: value}) + "\n")
    code, _, err = params(capsys, "undo")
    assert code == 2 and "nothing to undo" in err and len(err.splitlines()) == 1


def test_a_change_that_cannot_be_kept_is_made_and_reported(
    board: UartBoard, capsys: Capture, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    code, out, err = params(capsys, "set", "pid.kp=0.05", "--json")
    assert code == 0 and in_use(board)["pid.kp_q22"] != DEFAULTS["pid.kp_q22"]
    assert len(err.splitlines()) == 1 and "`plumb params undo` will not know this change" in err
    assert json.loads(out)["warnings"] == [err.strip().removeprefix("plumb: warning: ")]


def test_the_file_of_changes_does_not_grow_without_end() -> None:
    change = parameter_history.change_of("set", DEFAULTS, {**DEFAULTS, "arm_hold_ms": 5})
    for _ in range(2):
        parameter_history.write("some board", [change] * (parameter_history.MOST_CHANGES + 5))
    assert len(parameter_history.read("some board")) == parameter_history.MOST_CHANGES
    assert parameter_history.file_of("../../x").parent == parameter_history.file_of("y").parent


def test_the_tuning_that_was_chosen_is_remembered(board: UartBoard, capsys: Capture) -> None:
    """Even when another one is nearer by now; undo forgets it."""
    params(capsys, "tuning", "quad", "constant")
    params(capsys, "set", "trust.r=0.25", "trust.r_max=250", "trust.gain=1100", "kalman.q_angle=0.003", "pid.kp=0.05")
    _, out, _ = params(capsys, "list")
    assert out.startswith("quad, from its tuning 'constant'")
    for _ in range(2):
        params(capsys, "undo")
    _, out, _ = params(capsys, "list")
    assert out.startswith("quad, from its tuning 'trapezium'")


# ---- profiles ----


def test_a_profile_is_a_name_for_a_whole_table(board: UartBoard, capsys: Capture) -> None:
    params(capsys, "set", "pid.kp=0.05")
    windy = in_use(board)
    assert params(capsys, "profile", "save", "windy")[0] == 0
    params(capsys, "tuning", OTHER)
    other = in_use(board)
    assert params(capsys, "profile", "list")[1] == "  windy\n"
    code, _, err = params(capsys, "profile", "use", "windy")
    assert (code, err) == (0, "") and in_use(board) == windy
    _, out, _ = params(capsys, "profile", "list", "--json")
    assert json.loads(out) == {"board": "000000012222222233333333", "profiles": ["windy"], "in_use": ["windy"]}
    assert params(capsys, "undo")[0] == 0 and in_use(board) == other


def test_a_profile_belongs_to_one_board(board: UartBoard, capsys: Capture) -> None:
    params(capsys, "profile", "save", "windy")
    board.wires.identity.unique_id[:] = (9, 9, 9)
    board.reset()
    code, _, err = params(capsys, "profile", "use", "windy")
    assert code == 2 and "this board has no profile 'windy'; it has none" in err


def test_a_profile_is_replaced_by_force_alone(board: UartBoard, capsys: Capture) -> None:
    params(capsys, "profile", "save", "windy")
    params(capsys, "set", "pid.kp=0.05")
    code, _, err = params(capsys, "profile", "save", "windy")
    assert code == 2 and "--force" in err
    assert params(capsys, "diff", "profile:windy")[0] == 1
    assert params(capsys, "profile", "save", "windy", "--force")[0] == 0
    assert params(capsys, "diff", "profile:windy")[0] == 0
    assert params(capsys, "profile", "delete", "windy")[0] == 0
    assert params(capsys, "profile", "delete", "windy")[0] == 2


@pytest.mark.parametrize("name", ["../x", "a/b", ".hidden", "x" * 65, "a\nb"])
def test_a_name_that_is_no_file_is_refused(board: UartBoard, capsys: Capture, name: str) -> None:
    code, _, err = params(capsys, "profile", "save", name)
    assert code == 2 and "is no name of a profile" in err
    assert not places.config_folder().exists()


def test_a_profile_needs_a_name(board: UartBoard, capsys: Capture) -> None:
    assert "say which profile" in params(capsys, "profile", "use")[2]


# ---- diff ----


def test_diff_compares_two_of_board_tuning_defaults_file_and_profile(
    board: UartBoard, capsys: Capture, tmp_path: Path
) -> None:
    params(capsys, "tuning", "quad")
    assert params(capsys, "diff") == (0, "from the tuning 'trapezium' of quad to the board: nothing differs\n", "")
    params(capsys, "dump", str(tmp_path / "a.toml"))
    params(capsys, "set", "pid.kp=0.05", "kalman.rate=current")
    code, out, _ = params(capsys, "diff")
    assert code == 1 and out.splitlines()[1:] == ["kalman.rate: trapezium -> current", "pid.kp: 0.045 -> 0.05 1/deg"]
    code, out, _ = params(capsys, "diff", "board", str(tmp_path / "a.toml"))
    assert code == 1 and out.splitlines()[-1] == "pid.kp: 0.05 -> 0.045 1/deg"
    code, out, _ = params(capsys, "diff", "defaults", str(tmp_path / "a.toml"), "--json")
    assert code == 1 and json.loads(out)["quantities"] == {"esc_period_us": {"from": 20000, "to": 2500, "unit": "us"}}
    code, out, _ = params(capsys, "diff", "--raw")
    assert code == 1 and "pid.kp_q22: 67947725 -> 75497472 (0.05 1/deg)" in out


@pytest.mark.parametrize("side", ["nowhere.toml", "profile:none", "profile:", "."])
def test_a_side_that_is_not_there_is_a_sentence(board: UartBoard, capsys: Capture, side: str) -> None:
    code, out, err = params(capsys, "diff", side)
    assert code == 2 and out == "" and len(err.splitlines()) == 1


# ---- edit ----


def test_what_was_edited_is_committed_and_nothing_else(board: UartBoard, capsys: Capture, editing: Path) -> None:
    edits(editing, "text = text.replace('pid.kp = 0.045', 'pid.kp = 0.05').replace('\"atan2\"', '\"arcsine\"')")
    code, out, err = params(capsys, "edit")
    assert (code, err) == (0, "") and "2 changed" in out
    assert in_use(board) == {**DEFAULTS, "pid.kp_q22": round(0.05 * 360 * 2**22), "tilt.mode": 0}
    assert not list(editing.parent.glob("plumb-params-*"))
    assert params(capsys, "undo", "--list")[1].split("  ")[1] == "edit"


@pytest.mark.parametrize("how", ["pass", "text = ''"])
def test_a_text_that_was_not_edited_changes_nothing(board: UartBoard, capsys: Capture, editing: Path, how: str) -> None:
    edits(editing, how)
    code, out, _ = params(capsys, "edit")
    assert code == 0 and "nothing was edited" in out and in_use(board) == DEFAULTS


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("text += 'pid.kp = 1'", "is no TOML file"),
        ("text = text.replace('pid.kp = 0.045', 'pid.kp = 99')", "the most is 0.711111"),
        ("text = text.replace('pid.kp = 0.045', 'pid.kp = true')", "pid.kp is neither a number nor a text"),
        ("text = text.replace('pid.kp = 0.045', 'pid.kp = [1]')", "pid.kp is neither a number nor a text"),
        ("text = text.replace('pid.kp = 0.045', 'pid.kp = nan')", "give a finite number"),
        ("text = text.replace('pid.kp', 'pid.kpp')", "there is no parameter 'pid.kpp' in units; did you mean"),
        ("text = text.replace('pid.kp', 'kp = 1\\npid.kp')", "pid.kp is there twice"),
        (f"text = text.replace('\"quad\"', '\"{OTHER}\"')", f"is for '{OTHER}', the board is a quad"),
        ("text = text.replace('arm_hold_ms = 1000', 'arm_hold_ms = ' + '9' * 5000)", "is no TOML file"),
        ("text = text.replace('arm_hold_ms = 1000', 'arm_hold_ms = 0.5')", "give a whole number"),
        ("text += '\"\\\\u001b[2J\" = 1'", r"there is no parameter '\x1b[2J'"),
    ],
)
def test_a_text_that_is_refused_stays(board: UartBoard, capsys: Capture, editing: Path, how: str, said: str) -> None:
    edits(editing, how)
    code, out, err = params(capsys, "edit")
    assert code == 2 and out == "" and said in err and in_use(board) == DEFAULTS
    (kept,) = editing.parent.glob("plumb-params-*/params.toml")
    assert f"your text is in {kept}" in err and "\x1b" not in err
    edits(editing, "text = text")


def test_a_text_is_loaded_like_a_file_of_integers(board: UartBoard, capsys: Capture, tmp_path: Path) -> None:
    (tmp_path / "some.toml").write_text("pid.kp = 0.05  # the others stay\n[esc]\nmax = 1900\n")
    code, out, err = params(capsys, "load", str(tmp_path / "some.toml"))
    assert (code, err) == (0, "") and "2 changed" in out
    assert in_use(board) == {**DEFAULTS, "pid.kp_q22": round(0.05 * 360 * 2**22), "esc.max_halfus": 3800}


def test_an_editor_that_is_not_there_or_fails_changes_nothing(
    board: UartBoard, capsys: Capture, editing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    editing.write_text("raise SystemExit(3)", encoding="utf-8")
    code, _, err = params(capsys, "edit")
    assert code == 2 and "ended with code 3: nothing was changed" in err
    for value, said in (("no-such-editor -w", "no-such-editor, which is not there"), ("'", "$VISUAL is no command")):
        monkeypatch.setenv("VISUAL", value)
        code, _, err = params(capsys, "edit")
        assert code == 2 and said in err
    monkeypatch.delenv("VISUAL")
    monkeypatch.delenv("EDITOR", raising=False)
    monkeypatch.setenv("PATH", "")
    assert "set $EDITOR to yours" in params(capsys, "edit")[2]
    assert in_use(board) == DEFAULTS


def test_a_list_of_profiles_takes_no_name(board: UartBoard, capsys: Capture) -> None:
    code, out, err = params(capsys, "profile", "list", "windy")
    assert (code, out) == (2, "") and "takes no name" in err
