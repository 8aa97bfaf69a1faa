"""Orders for the hand of a served board: what a line means, where lines come from, and calibration over a real port."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from plumb import __main__ as front
from plumb.boards import hand_orders
from plumb.boards.hand_orders import GrowingFile, HandOrders, Order
from plumb.errors import UsageError
from plumb.physics.hand import TiltingHand, TurningHand

POSES = ("level", "left side up", "left end up", "on its back")


@pytest.mark.parametrize(
    ("line", "order"),
    [
        ("level", Order("level")),
        ("  Left   Side up \r", Order("left side up")),
        ("2", Order("left side up")),
        ("on", Order("on its back")),
        ("left side up 50% 2s", Order("left side up", 2.0, 0.5)),
        ("level 2.5 s -300%", Order("level", 2.5, -3.0)),
        ("60s 4", Order("on its back", 60.0)),
        ("", None),
        ("   # a comment", None),
        ("level # and why", Order("level")),
    ],
)
def test_what_a_line_means(line: str, order: Order | None) -> None:
    assert hand_orders.parse(line, POSES) == order


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("left", r"'left' is none of the poses: 1 level, 2 left side up, 3 left end up, 4 on its back"),
        ("0", "none of the poses"),
        ("5", "none of the poses"),
        ("9" * 5000, "none of the poses"),
        ("50%", "'' is none of the poses"),
        ("level 0s", "a turn takes up to 60 s"),
        ("level 61s", "a turn takes up to 60 s"),
        ("level 401%", "up to 400 % of the way"),
        ("level 1s 2s", "'level 2s' is none of"),
        ("\x00\x1b[2J" + "x" * 1000, "none of the poses"),
    ],
)
def test_a_line_that_means_nothing_names_the_poses(line: str, said: str) -> None:
    with pytest.raises(UsageError, match=said) as caught:
        hand_orders.parse(line, POSES)
    assert len(str(caught.value)) < 200


def test_a_file_is_read_as_it_grows_or_is_written_anew(tmp_path: Path) -> None:
    path = tmp_path / "hand.txt"
    path.write_text("level\n")
    lines = GrowingFile(path)
    assert lines.read() == b""  # what stood there before
    with path.open("a") as file:
        file.write("front\n")
    assert lines.read() == b"front\n"
    assert lines.read() == b""
    path.write_text("right side up\n")  # longer than before, and another beginning
    assert lines.read() == b"right side up\n"
    path.unlink()
    assert lines.read() == b""
    path.write_text("back\n")
    assert lines.read() == b"back\n"
    path.write_text("x" * 100_000)
    lines = GrowingFile(path)
    with path.open("a") as file:
        file.write("over\n")
    assert lines.read() == b"over\n"
    path.write_text("y\n")  # shorter than before
    assert lines.read() == b"y\n"
    made = tmp_path / "new.txt"
    GrowingFile(made)
    assert made.read_text() == ""


def test_a_named_pipe_is_read_and_without_a_board_it_says_so(tmp_path: Path) -> None:
    pipe = tmp_path / "hand"
    os.mkfifo(pipe)
    with pytest.raises(UsageError, match=r"no board reads it: start `plumb virtual-board --system SYSTEM --hand"):
        hand_orders.send_order(str(pipe), "level")
    lines = hand_orders.lines_of(str(pipe))
    assert lines.read() == b""
    hand_orders.send_order(str(pipe), "left side up")
    assert lines.read() == b"left side up\n"
    assert lines.read() == b""
    for bad in (tmp_path, tmp_path / "no" / "folder", Path("/dev/null")):
        with pytest.raises(UsageError, match=r"name a file that can be read and written, or -"):
            hand_orders.lines_of(str(bad))


def test_a_pipe_that_a_stopped_board_has_filled_is_one_sentence(tmp_path: Path) -> None:
    pipe = tmp_path / "hand"
    os.mkfifo(pipe)
    lines = hand_orders.lines_of(str(pipe))
    with pytest.raises(UsageError, match="the board that reads it has stopped: start it anew"):
        for _ in range(1000):
            hand_orders.send_order(str(pipe), "level" * 100)
    assert lines.read().startswith(b"levellevel")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_full_disk_is_one_sentence() -> None:
    with pytest.raises(UsageError, match="/dev/full: No space left on device: name a file that can be written"):
        hand_orders.send_order("/dev/full", "level")


def test_a_file_that_becomes_something_else_is_silent_until_it_is_a_file_again(tmp_path: Path) -> None:
    """The board that reads it goes on: it does not end, and it does not wait for who writes into a pipe."""
    path = tmp_path / "hand.txt"
    lines = hand_orders.lines_of(str(path))
    path.unlink()
    path.mkdir()
    assert lines.read() == b""
    path.rmdir()
    os.mkfifo(path)
    assert lines.read() == b""
    path.unlink()
    path.write_text("level\n")
    assert lines.read() == b"level\n"


def test_orders_move_the_hand_and_mistakes_are_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr("plumb.boards.hand_orders.time.monotonic", lambda: clock[0])
    hand, said, path = TiltingHand({"level": 0.0, "side": 90.0}), list[str](), tmp_path / "hand.txt"
    orders = HandOrders(hand, hand_orders.lines_of(str(path)), said.append)

    def write(text: str) -> None:
        with path.open("a") as file:
            file.write(text)
        clock[0] += 1.0
        orders.look()

    write("side 50% 2s\nboat\n")
    assert said == ["hand: side, 50 % of the way, within 2 s", "hand: 'boat' is none of the poses: 1 level, 2 side"]
    assert hand.at(1.0) == pytest.approx((22.5, 35.343), abs=1e-3) and hand.at(2.5) == pytest.approx((45.0, 0.0))
    write("lev")  # half a line waits for its end
    assert len(said) == 2
    write("el\n")
    assert said[2] == "hand: level, within 1 s" and hand.at(4.0)[0] == 0.0
    hand_orders.send_order(str(path), "side")
    orders.look()
    assert len(said) == 3  # not more often than EVERY_S
    clock[0] += 1.0
    orders.look()
    assert said[3] == "hand: side, within 1 s"


def test_a_hand_in_space_turns_the_short_way_and_right_over() -> None:
    hand = TurningHand({"level": (0, 0, 1), "left": (0, 1, 0), "over": (0, 0, -1)})
    hand.put("left")
    up, rates = hand.at(0.5)
    assert up == pytest.approx((0.0, 0.5**0.5, 0.5**0.5)) and rates == pytest.approx((141.37, 0.0, 0.0), abs=0.01)
    assert hand.at(1.0)[0] == pytest.approx((0.0, 1.0, 0.0))
    hand.put("level")
    assert hand.at(1.5)[1] == pytest.approx((-141.37, 0.0, 0.0), abs=0.01)
    hand.at(3.0)
    hand.put("over")
    assert sum(hand.at(3.5)[0] ** 2) == pytest.approx(1.0) and hand.at(3.5)[0][2] == pytest.approx(0.0, abs=1e-12)
    assert hand.at(9.0)[0] == pytest.approx((0.0, 0.0, -1.0))
    hand.put("over")  # where it is already
    assert hand.at(9.5)[1] == pytest.approx((0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["virtual-board", "--hand", "-"], "--hand holds the body of a system: name it with --system"),
        (["virtual-board", "--hand", "-", "--system", "quad", "--scenario", "hold"], "leave --scenario out"),
        (["virtual-board", "--hand", "-", "--system", "turntable"], "turntable: no poses are declared"),
        (["virtual-board", "--hand", "/no/folder/x", "--system", "quad"], "name a file that can be read and written"),
        (
            ["calibrate", "--board", "native", "--system", "quad", "--hand", "x"],
            "--hand names the file of a board that",
        ),
        (["calibrate", "--board", "serial:/dev/no-such", "--hand", "-"], "--hand names the file of a board that"),
    ],
)
def test_wrong_use(arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answers = tmp_path / "answers.toml"
    answers.write_text("write = true\nsave = true\n")
    more = ["--answers", str(answers)] if arguments[0] == "calibrate" else []
    assert front.main([*arguments, *more]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.long  # in real time: on a busy machine the served board falls behind, and its samples are too few
def test_setup_ends_green_over_a_terminal_on_a_board_that_another_process_holds(tmp_path: Path) -> None:
    """The orders that `plumb setup` writes hold the served board; its calibration is written, and all is well."""
    environment = {**os.environ, "XDG_CONFIG_HOME": str(tmp_path / "c"), "XDG_STATE_HOME": str(tmp_path / "s")}
    plumb = [sys.executable, "-m", "plumb"]
    served = ["virtual-board", "--port", "native", "--system", "quad", "--hand", "hand.txt", "--symlink", "board"]
    (tmp_path / "answers.toml").write_text(
        'system = "quad"\nflash = false\ntuning = true\ncalibrate = true\nwrite = true\nsave = true\nremember = true\n'
    )
    with (tmp_path / "hand.out").open("w") as output:
        holder = subprocess.Popen([*plumb, *served], cwd=tmp_path, env=environment, stdout=output, stderr=output)
    try:
        until = time.monotonic() + 60.0
        while not (tmp_path / "board").exists() and time.monotonic() < until:
            time.sleep(0.05)
        asked = ["setup", "--board", "serial:board", "--hand", "hand.txt", "--answers", "answers.toml", "--json"]
        done = subprocess.run([*plumb, *asked], cwd=tmp_path, env=environment, capture_output=True, text=True)
    finally:
        holder.send_signal(signal.SIGINT)
        holder.wait(30)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"green": True, "board": "serial:board", "calibrated": True, "troubles": []}
    assert "in use, and saved" in done.stderr
    assert "hand: motor 1 up, within 1 s" in (tmp_path / "hand.out").read_text()
