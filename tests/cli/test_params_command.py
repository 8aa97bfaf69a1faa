"""`plumb params`: what the integers mean, a change that is whole or refused, and a file that brings a table back."""

from __future__ import annotations

import json
import os
import threading
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from plumb import __main__ as front
from plumb import systems
from plumb.boards.link import LinkBoard
from plumb.contract.scenario import LinkedSensors
from plumb.errors import UsageError
from plumb.link.identity import Identity, identity_of
from plumb.link.session import Session
from plumb.spec import declarations, parameter_file, parameters
from plumb.spec.units import meaning
from support.declared_systems import of_declared, without_outputs
from support.native_board import UartBoard
from support.params_command import in_use, params

DEFAULTS = {row.name: row.default for row in parameters.table()}
ROWS = {row.name: row for row in parameters.table()}


MANY_0, MANY_F = "0" * 5000, "f" * 5000


@pytest.mark.parametrize(
    ("name", "value", "means"),
    [
        ("gyro.gain", 1 << 28, "360 deg/s per count"),
        ("gyro.offset", -(1 << 27), "-180 deg/s"),
        ("accel.gain", 1 << 20, "0.015625 g per count"),
        ("tilt.mode", 0, "arcsine of the horizontal axis / 1 g"),
        ("tilt.mode", 1, "atan2(horizontal axis, axis upwards)"),
        ("kalman.rate_now", 1, "the current one"),
        ("kalman.rate_now", 2, "the mean of both"),
        ("tilt.r_base", 9321, ""),  # in a unit that the board does not know
        ("tilt.r_gain", 5, ""),
        ("kalman.qb_frac_q30", 1 << 29, ""),
        ("kalman.dt_s_q33", 1 << 31, "0.25 s"),
        ("kalman.rate_gain", 1 << 30, "32 step/s"),  # Q(31 - 6)
        ("start.tilt_turn_q32", -(1 << 30), "-90 deg"),
        ("pid.kp_q22", 360 << 22, "1 1/deg"),
        ("pid.kd_q27", 180 << 27, "0.5 s/deg"),
        ("esc.mid_halfus", 3001, "1500.5 us"),
        ("period_us", 500, "500 us"),
    ],
)
def test_what_an_integer_means(name: str, value: int, means: str) -> None:
    assert str(meaning(ROWS[name], {**DEFAULTS, name: value})) == means


@pytest.mark.parametrize(
    ("name", "value", "means"),
    [("kalman.bias_max_turn_q29", 1 << 29, "1440 deg/s"), ("pid.slew_q22", 1 << 20, "1 1/s")],
)
def test_what_is_counted_per_step_means_something_by_the_period(name: str, value: int, means: str) -> None:
    assert str(meaning(ROWS[name], {**DEFAULTS, "kalman.dt_s_q33": 1 << 31, name: value})) == means


def test_the_list_has_every_parameter_and_the_crc(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = params(capsys, "list", "--raw", "--json")
    said = json.loads(out)
    assert code == 0
    assert {entry["name"]: entry["value"] for entry in said["parameters"]} == DEFAULTS
    assert said["crc32"] == f"0x{parameters.crc32(list(DEFAULTS.values())):08x}"
    _, out, _ = params(capsys, "list", "--raw")
    assert len(out.splitlines()) == 1 + len(DEFAULTS)


def test_a_change_is_committed_and_marked(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = params(capsys, "set", "--raw", "esc.mid_halfus=0xbb9", "pid.kp_q22=-5")
    assert code == 0 and err == ""
    assert "esc.mid_halfus: 3000 -> 3001 (1500.5 us)" in out and "set by a host and not saved" in out
    wanted = {**DEFAULTS, "esc.mid_halfus": 3001, "pid.kp_q22": -5}
    assert in_use(board) == wanted
    _, out, _ = params(capsys, "get", "--raw", "pid.kp_q22", "esc.mid_halfus", "--json")
    assert [entry["value"] for entry in json.loads(out)["parameters"]] == [-5, 3001]
    _, out, _ = params(capsys, "list", "--raw")
    assert [row.split()[1] for row in out.splitlines() if row.startswith("*")] == ["pid.kp_q22", "esc.mid_halfus"]
    board.reset()
    assert in_use(board) == DEFAULTS


@pytest.mark.parametrize(
    ("assignments", "sentence"),
    [
        (["pid.kp=1"], "no parameter 'pid.kp'; did you mean pid.kp_q22?"),
        (["esc.middle_halfus=1"], "did you mean esc.mid_halfus"),
        (["qwxyz=1"], "`plumb params list` names them all"),
        (["esc.mid_halfus=99999"], "esc.mid_halfus = 99999 is outside 1800 to 4200 (unit 0.5 us); nothing"),
        (["pid.kp_q22=99999999999"], "(Q22, unit 1/turn); nothing was changed"),
        (["esc.mid_halfus=4294970296"], "is outside 1800 to 4200"),  # 3000 modulo 2^32
        (["kalman.qb=-1"], "is outside 0 to 4294967295"),
        (["esc.neutral_halfus=3000"], "that of a two-way (3D) controller; plumb drives one-way PWM controllers alone"),
        (["esc.min_halfus=250", "esc.max_halfus=500"], "125 us is a pulse of OneShot125"),
        (["esc_period_us=500"], "frames of 500 us are for OneShot125, OneShot42, Multishot or DShot controllers"),
        (["esc.mid_halfus=1.5"], "'1.5' is no integer: esc.mid_halfus is an integer (unit 0.5 us)"),
        (["esc.mid_halfus"], "write NAME=VALUE"),
        (["esc.mid_halfus=3001", "esc.mid_halfus=3002"], "set twice"),
        (["esc.mid_halfus=3001", "esc.max_halfus=2900"], "contradict each other"),
    ],
)
def test_a_refusal_is_one_sentence_and_changes_nothing(
    board: UartBoard, capsys: pytest.CaptureFixture[str], assignments: list[str], sentence: str
) -> None:
    code, out, err = params(capsys, "set", "--raw", *assignments)
    assert code == 2 and out == ""
    assert sentence in err and len(err.splitlines()) == 1
    assert in_use(board) == DEFAULTS


def test_two_periods_that_differ_are_warned_of(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = params(capsys, "set", "--raw", "period_us=10000", "--json")
    assert code == 0 and "kalman.dt_s_q33" in err
    assert json.loads(out)["warnings"] == [err.strip().removeprefix("plumb: warning: ")]
    code, _, err = params(capsys, "set", "--raw", "kalman.dt_s_q33=85899346")
    assert code == 0 and err == ""


def test_a_file_brings_a_table_back(board: UartBoard, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "table.toml"
    params(capsys, "set", "--raw", "pid.kp_q22=7", "accel_up.offset=-137000000", "kalman.qb=4294967295")
    before = in_use(board)
    assert params(capsys, "dump", str(file))[0] == 0
    said = tomllib.loads(file.read_text())
    assert said["values"] == before
    assert said["crc32"] == f"0x{parameters.crc32(list(before.values())):08x}"
    board.reset()
    code, out, err = params(capsys, "load", str(file))
    assert code == 0 and err == "" and f"CRC-32 {said['crc32']}: 3 changed" in out
    assert in_use(board) == before
    assert list(tmp_path.iterdir()) == [file]


def test_unknown_missing_and_edited_are_warned_of_by_name(
    board: UartBoard, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "table.toml"
    params(capsys, "dump", str(file))
    whole = file.read_text()
    file.write_text(whole.replace('"pid.kp_q22" = 67947725', '"pid.kp_q22" = 8'))
    code, _, err = params(capsys, "load", str(file))
    assert code == 0 and "it was edited" in err and len(err.splitlines()) == 1
    params(capsys, "set", "--raw", "tilt.mode=0")
    file.write_text(whole.replace('"tilt.mode"', '"tilt.modus"'))
    code, out, err = params(capsys, "load", str(file), "--json")
    assert code == 0 and len(err.splitlines()) == 2
    assert "no parameter 'tilt.modus'" in err and "tilt.mode is missing; the board's value stays" in err
    assert json.loads(out)["changed"] == {"pid.kp_q22": {"from": 8, "to": 67947725}}
    assert in_use(board)["tilt.mode"] == 0


def test_a_former_name_in_a_file_is_taken_and_the_new_one_named(
    board: UartBoard, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "table.toml"
    params(capsys, "set", "--raw", "accel.gain=67585")
    params(capsys, "dump", str(file))
    file.write_text(file.read_text().replace('"accel.gain"', '"accel_y.gain"'))
    params(capsys, "set", "--raw", "accel.gain=67580")
    code, _, err = params(capsys, "load", str(file))
    assert code == 0 and in_use(board)["accel.gain"] == 67585
    assert err.splitlines() == [f"plumb: warning: {file}: accel_y.gain is named accel.gain now; the value is used"]
    file.write_text(file.read_text() + '"accel.gain" = 6\n')
    code, out, err = params(capsys, "load", str(file))
    assert code == 2 and out == "" and "accel_y.gain is the former name of accel.gain, which is there, too" in err


@pytest.mark.parametrize("words", [("set", "--raw", "accel_z.offset=1"), ("get", "--raw", "accel_z.offset")])
def test_a_former_name_on_the_command_line_is_answered_with_the_new_one(
    board: UartBoard, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    code, out, err = params(capsys, *words)
    assert code == 2 and out == "" and "accel_z.offset is named accel_up.offset now" in err


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("values", "is no TOML file"),
        ("[value]\n", "has no [values]"),
        ('[values]\n"tilt.mode" = true\n', "tilt.mode = True is no integer"),
        ('[values]\n"tilt.mode" = 2\n', "tilt.mode = 2 is outside 0 to 1"),
        (f"period_us = 1{MANY_0}\n", "is no TOML file"),
        (f'[values]\n"tilt.mode" = 0x{MANY_F}\n', "tilt.mode = 0xffffffff.. is outside 0 to 1"),
        (f'[values]\n"esc.min_halfus" = 0x{MANY_F}\n', "esc.min_halfus = 0xffffffff.. is outside"),
        (f'[values]\n"tilt.mode" = [0x{MANY_F}]\n', "tilt.mode = a list is no integer"),
        (f'[values]\n"tilt.mode" = "{MANY_F}"\n', "fff..' is no integer; write a whole number"),
        (None, "cannot read"),
    ],
)
def test_a_bad_file_is_refused_in_a_sentence(
    board: UartBoard, capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str | None, sentence: str
) -> None:
    file = tmp_path / "table.toml"
    if text is not None:
        file.write_text(text)
    code, out, err = params(capsys, "load", str(file))
    assert code == 2 and out == "" and sentence in err and len(err.splitlines()) == 1
    assert in_use(board) == DEFAULTS


def test_a_foreign_name_in_a_file_says_nothing_to_the_terminal(
    board: UartBoard, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "table.toml"
    file.write_text(f'[values]\n"tilt.mode" = 0\n"\\u001b[2J\\n{MANY_F}" = 1\n')
    code, _, err = params(capsys, "load", str(file))
    assert code == 0 and "\x1b" not in err
    foreign = [line for line in err.splitlines() if "no parameter" in line]
    # MANY_F is thousands of letters: it is cut, and the sentence about it has its words.
    assert len(foreign) == 1 and r"\x1b[2J\n" in foreign[0] and len(foreign[0]) < len(str(file)) + 150


@pytest.mark.parametrize("name", ["tilt.mode", "esc.neutral_halfus"])
def test_a_number_of_any_length_is_out_of_range(
    board: UartBoard, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    code, out, err = params(capsys, "set", "--raw", f"{name}=0x{MANY_F}")
    assert code == 2 and out == "" and f"{name} = 0xffffffff.. is outside" in err and len(err.splitlines()) == 1


def test_a_table_that_came_back_wrong_is_link_trouble(
    board: UartBoard, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Session, "read_parameters", lambda _self: list(range(len(DEFAULTS))))
    code, out, err = params(capsys, "list", "--raw")
    assert code == 3 and out == "" and "CRC-32" in err


@pytest.mark.parametrize("spec", ["native", "qemu"])
def test_only_a_board_with_a_link_has_parameters(spec: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["params", "list", "--board", spec]) == 2
    assert "no board with a link" in capsys.readouterr().err


@pytest.mark.parametrize("system", list(systems.SYSTEMS))
def test_a_board_becomes_a_system_with_its_shipped_tuning(
    board: UartBoard, capsys: pytest.CaptureFixture[str], system: str
) -> None:
    from plumb.contract.parameters import quantise

    code, out, _ = params(capsys, "tuning", system, "--json")
    changed = json.loads(out)["changed"]
    module = systems.load(system)
    tuned = quantise(module.TUNINGS[module.DEFAULT_TUNING])
    sensors = module.SENSOR_LINKS.get(module.DEFAULT_TUNING, {}) if isinstance(module, LinkedSensors) else {}
    values = {**tuned.values, **tuned.link_words(), "period_us": module.PERIOD_US, **module.LINK, **sensors}
    rows = {row.name: row.default for row in parameters.table()}
    assert code == 0
    assert {name: row["to"] for name, row in changed.items()} == {
        name: value for name, value in values.items() if value != rows[name]
    }


@pytest.mark.parametrize("system", list(systems.SYSTEMS))
def test_no_shipped_tuning_is_doubted(board: UartBoard, capsys: pytest.CaptureFixture[str], system: str) -> None:
    """Each has its own filter, whose period is that of its runs; another period is doubted by name."""
    code, _, err = params(capsys, "tuning", system)
    assert code == 0 and "angles will be wrong" not in err
    _, _, err = params(capsys, "set", "--raw", "period_us=7000")
    assert f"({declarations.system(system).period}): its angles will be wrong" in err


@pytest.mark.parametrize(
    ("system", "pins"), of_declared([("quad", 0), ("balancer", 1), *((name, 1) for name in without_outputs())])
)
def test_a_tuning_brings_the_pins_of_what_the_system_moves(
    board: UartBoard, capsys: pytest.CaptureFixture[str], system: str, pins: int
) -> None:
    """After a balancer; what moves nothing leaves the wiring as it is."""
    assert params(capsys, "set", "pins=1")[0] == 0
    assert params(capsys, "tuning", system)[0] == 0
    _, out, _ = params(capsys, "get", "pins", "--json")
    assert json.loads(out)["parameters"][0]["value"] == pins


# ---- in units ----


def listed(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, dict[str, Any]]:
    _, out, _ = params(capsys, "list", *arguments, "--json")
    return {entry["alias"]: entry for entry in json.loads(out)["parameters"]}


def test_values_are_set_in_units(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = params(capsys, "set", "pid.kp=0.05", "kalman.q_bias=2e-4", "kalman.r=0.05", "tilt=arcsine")
    assert code == 0 and err == ""
    assert out.splitlines()[:-1] == [
        "kalman.q_bias: 0.01 -> 0.0002 (deg/s)^2/s",
        "trust.r: 3.99995 -> 0.05 deg^2",
        "tilt: atan2 -> arcsine",
        "pid.kp: 0.045 -> 0.05 1/deg",
    ]
    assert "4 changed; they are set by a host and not saved" in out
    assert in_use(board)["pid.kp_q22"] == round(0.05 * 360 * 2**22) and in_use(board)["tilt.mode"] == 0
    found = listed(capsys)
    assert [found[name]["value"] for name in ("kalman.q_bias", "trust.r")] == pytest.approx([2e-4, 0.05], rel=1e-3)


def test_a_period_keeps_the_angles_right(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = params(capsys, "set", "period_us=10000")
    assert code == 0 and err == "" and out.splitlines()[0] == "period_us: 20000 -> 10000 us"
    assert in_use(board)["kalman.dt_s_q33"] == round(0.01 * 2**33)


def test_the_list_marks_what_differs_from_the_tuning_it_came_from(
    board: UartBoard, capsys: pytest.CaptureFixture[str]
) -> None:
    assert params(capsys, "tuning", "balancer")[0] == 0
    params(capsys, "set", "drive.fall=40", "accel_bus=1")
    _, out, _ = params(capsys, "list")
    head, _, *lines = out.splitlines()
    assert head == "balancer, from its tuning 'tuned': 2 parameters differ (*)"
    starred = [line.split() for line in lines if line.startswith("*")]
    assert [words[1] for words in starred] == ["drive.fall", "accel_bus"]
    assert starred[0][2:5] == ["40", "deg", "45"]
    assert {name for name, one in listed(capsys).items() if one["differs"]} == {"drive.fall", "accel_bus"}
    assert all(one["unit"] and one["meaning"] for one in listed(capsys).values())


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("derivative", {"pid.kd", "pid.derivative_tau"}),
        ("PID.K*", {"pid.kp", "pid.ki", "pid.kd"}),
        ("arm_hold_ms", {"arm_hold_ms"}),
    ],
)
def test_a_filter_takes_names_meanings_and_patterns(
    board: UartBoard, capsys: pytest.CaptureFixture[str], pattern: str, names: set[str]
) -> None:
    assert set(listed(capsys, pattern)) == names


@pytest.mark.parametrize("arguments", [("list", "qwxyz"), ("list", "qwxyz*"), ("list", "qwxyz", "--raw")])
def test_a_filter_without_a_hit_is_a_sentence(
    board: UartBoard, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    code, out, err = params(capsys, *arguments)
    assert code == 2 and out == "" and "qwxyz" in err and len(err.splitlines()) == 1


def test_get_says_limits_and_integers(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = params(capsys, "get", "pid.kp", "tilt")
    assert code == 0 and "-0.711111 .. 0.711111 1/deg" in out and "held by pid.kp_q22 = 67947725" in out
    assert "arcsine or atan2" in out
    _, out, _ = params(capsys, "get", "pid.slew", "--json")
    entry = json.loads(out)["parameters"][0]
    assert entry["max"] is None and entry["words"] == ["pid.slew_q22"]  # any rate is taken: no limit


@pytest.mark.parametrize(
    ("assignments", "sentence"),
    [
        (["pid.kp=fast"], "pid.kp = 'fast': give a number in 1/deg"),
        (["pid.kp=nan"], "pid.kp_per_deg is nan: give a finite number"),
        (["pid.kp=1e400"], "finite"),
        (["pid.kp=1e9"], "the most is"),
        (["pid.kp="], "give a number"),
        (["tilt=arctan"], "tilt = 'arctan': give arcsine or atan2"),
        (["arm_hold_ms=0.5"], "give a whole number in ms"),
        (["arm_hold_ms=0x" + MANY_F], "arm_hold_ms: no parameter is as large as"),
        (["arm_hold_ms=-1"], "outside 0 to 10000"),
        (["esc.min=2100"], "more than mid_us"),
        (["pid.kp"], "write NAME=VALUE, for example pid.kp=0.05"),
        (["kp=1", "pid.kp_per_deg=2"], "pid.kp is set twice"),
        (["pid.kp=0.03", "nonsense=1"], "there is no parameter 'nonsense'"),
        (["pid.kp_q22=5"], "pid.kp_q22 is an integer of the table, which --raw"),
        (["system=1"], "system is an integer of the table"),
    ],
)
def test_a_refusal_in_units_is_one_sentence_and_changes_nothing(
    board: UartBoard, capsys: pytest.CaptureFixture[str], assignments: list[str], sentence: str
) -> None:
    code, out, err = params(capsys, "set", *assignments)
    assert code == 2 and out == "" and sentence in err and len(err.splitlines()) == 1
    assert in_use(board) == DEFAULTS


def test_integers_that_stand_for_no_tuning_are_still_listed_raw(
    board: UartBoard, capsys: pytest.CaptureFixture[str]
) -> None:
    params(capsys, "tuning", "balancer")
    assert params(capsys, "set", "--raw", "wheel.alpha_q31=0")[0] == 0
    code, out, err = params(capsys, "list")
    assert code == 2 and out == "" and "`plumb params list --raw` shows them" in err
    assert params(capsys, "list", "--raw", "wheel")[0] == 0


def test_a_board_of_other_definitions_is_shown_in_integers(
    board: UartBoard, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def of_other_definitions(*of: Any) -> Identity:
        return replace(identity_of(*of), mismatch="the board was built from other message definitions")

    monkeypatch.setattr("plumb.link.board_frames.identity_of", of_other_definitions)
    code, out, err = params(capsys, "list")
    assert code == 0 and "shown as integers" in err and len(out.splitlines()) == 1 + len(DEFAULTS)
    code, out, err = params(capsys, "set", "pid.kp=0.05")
    assert code == 3 and out == "" and "other message definitions" in err


def test_a_tuning_that_is_none_is_wrong_use(board: UartBoard, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = params(capsys, "tuning", "quad", "sharpest")
    assert code == 2 and "adaptive" in err


@pytest.mark.slow
@pytest.mark.parametrize("link", ["serial", "can"])
def test_every_verb_over_either_link(
    link: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the flash image of a board that stays the same one, and is switched off in between."""
    pytest.importorskip("unicorn", reason="the virtual board needs unicorn (the extra virtual)")
    from plumb.boards.virtual_can import MachineBus
    from plumb.boards.virtual_machine import open_machine

    try:
        machine = open_machine()
    except UsageError as error:
        pytest.skip(str(error))

    def opened(_spec: str, **_options: Any) -> LinkBoard:
        return LinkBoard(link, Session.over(MachineBus(machine)) if link == "can" else Session.open(machine.uart))

    monkeypatch.setattr("plumb.boards.open_link_board", opened)
    file = tmp_path / "table.toml"

    def value() -> int:
        code, out, _ = params(capsys, "get", "arm_hold_ms", "--json")
        assert code == 0
        return int(json.loads(out)["parameters"][0]["value"])

    for arguments, after in (
        (["set", "arm_hold_ms=5"], 5),
        (["save"], 5),
        (["set", "arm_hold_ms=6"], 6),
        (["dump", str(file)], 6),
        (["load"], 5),
        (["reset"], 1000),
        (["load", str(file)], 6),
    ):
        code, _, err = params(capsys, *arguments)
        assert (code, err, value()) == (0, "", after)
    machine.power_cut()
    machine.power_on()
    machine.advance_us(30_000)
    assert value() == 5
    assert machine.warnings == []


def test_a_table_goes_into_a_pipe_or_a_device_and_does_not_replace_it(tmp_path: Path) -> None:
    """`plumb params dump /dev/null` as root leaves /dev/null what it is, and a link a link."""
    text = parameter_file.text_of([row.default for row in parameters.table()])
    link, target = tmp_path / "link.toml", tmp_path / "target.toml"
    target.write_text("old")
    link.symlink_to(target)
    parameter_file.write(link, text)
    assert link.is_symlink() and target.read_text() == text
    pipe, received = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: received.append(pipe.read_text()))
    reader.start()
    parameter_file.write(pipe, text)
    reader.join()
    assert pipe.is_fifo() and received == [text]
