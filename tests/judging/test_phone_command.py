"""`plumb phone`: the command over loopback, on every board that it takes, and how it ends."""

from __future__ import annotations

import json
import re
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from plumb import __main__ as front
from plumb import boards
from plumb.boards import open_board, qemu
from plumb.boards.contract import StepBoard
from plumb.judging.phone.inputs import live_run, udp
from support.phone_datagrams import run_of, sensagram, sensorstream
from support.phone_feed import Sender, Wrong

IMAGE = Path(__file__).parents[2] / "build/stm32f103/plumb_qemu.elf"
needs_qemu = pytest.mark.skipif(
    shutil.which(qemu.PROGRAM) is None or not IMAGE.is_file(),
    reason="qemu-system-arm or its image is missing: apt install qemu-system-arm, make image",
)


Sending = Callable[..., None]


@pytest.fixture
def sending(monkeypatch: pytest.MonkeyPatch) -> Iterator[Sending]:
    """For the command itself, which opens the port on its own (--udp 0: a free one). Once it listens, these datagrams
    come; Ctrl-C after so many."""
    started: list[Sender] = []

    def prepare(datagrams: list[bytes], interrupt_after: int | None = None) -> None:
        listen, receive = udp.Listener.__init__, udp.Listener.receive
        taken = [0]

        def then_send(self: Any, *given: Any, **named: Any) -> None:
            listen(self, *given, **named)
            started.append(Sender(self.port, datagrams, lambda: taken[0]))
            started[-1].start()

        def counting(self: Any) -> Any:
            arrived = receive(self)
            taken[0] += arrived is not None
            if taken[0] == interrupt_after:
                signal.raise_signal(signal.SIGINT)
            return arrived

        monkeypatch.setattr(udp.Listener, "__init__", then_send)
        monkeypatch.setattr(udp.Listener, "receive", counting)

    yield prepare
    for sender in started:
        sender.stopped.set()
        sender.join()


@pytest.fixture
def native() -> Iterator[StepBoard]:
    with open_board("native") as board:
        yield board


@pytest.mark.parametrize("dies", [True, False])
def test_what_was_done_before_a_board_failed_is_reported(
    dies: bool,
    native: StepBoard,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    sending: Sending,
) -> None:
    """On a terminal, where the line of angles must end before anything else is said."""
    out = tmp_path / "report"
    sending(sensagram(run_of())[:900])
    monkeypatch.setattr(boards, "open_board", lambda *_, **__: Wrong(native, dies=dies))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    arguments = ["--udp", "0", "--seconds", "3", "--out", str(out)]
    assert front.main(["phone", "--board", "serial:gone", *arguments]) == (3 if dies else 1)
    said = capsys.readouterr()
    shown = re.search(r"\x1b\[K\nphone at udp:[1-9]\d*: (\d+) steps", said.out)
    assert shown is not None
    steps = int(shown[1])
    assert 100 <= steps < 200 if dies else steps == 300, "what was on its way when the board went is not counted"
    assert said.out.rstrip().endswith("pass" if dies else "fail")
    assert ("the board went away" in said.err) is dies
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["steps"], summary["verdict"]) == ((steps, "pass") if dies else (200, "fail"))


@pytest.mark.parametrize("after", [300, 2])
def test_ctrl_c_ends_with_a_report_of_what_was_done(
    after: int, sending: Sending, capsys: pytest.CaptureFixture[str]
) -> None:
    sending(sensagram(run_of()), interrupt_after=after)
    assert front.main(["phone", "--board", "native", "--udp", "0", "--json"]) == 130
    said = capsys.readouterr()
    assert said.err.splitlines()[-1] == "plumb: interrupted."
    if after == 2:
        assert said.out == ""
    else:
        answer = json.loads(said.out)
        assert answer["verdict"] == "pass" and answer["steps"] == pytest.approx(146, abs=3)


@needs_qemu
def test_qemu_is_given_the_run_when_it_is_over(sending: Sending, capsys: pytest.CaptureFixture[str]) -> None:
    sending(sensagram(run_of())[:500])
    assert front.main(["phone", "--board", "qemu", "--udp", "0", "--seconds", "2", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["verdict"], answer["steps"], answer["board"]) == ("pass", 200, "qemu")


@pytest.mark.parametrize("link", ["serial", "can"])
def test_the_flash_image_follows_a_phone(link: str, sending: Sending, capsys: pytest.CaptureFixture[str]) -> None:
    sending(sensorstream(run_of())[:200])
    arguments = ["--link", link, "--udp", "0", "--seconds", "1.5", "--json"]
    assert front.main(["phone", "--board", "virtual", *arguments]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["verdict"], answer["steps"], answer["link"]) == ("pass", 150, link)


def test_a_phone_that_stops_before_its_time_is_link_trouble(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], sending: Sending
) -> None:
    monkeypatch.setattr(live_run, "SILENCE_S", 0.5)
    sending(sensagram(run_of())[:400])
    assert front.main(["phone", "--board", "native", "--udp", "0", "--seconds", "60"]) == 3
    said = capsys.readouterr()
    assert "pass" in said.out and said.err.splitlines()[-1].endswith("the phone stopped sending")


def test_the_command_feeds_saves_reports_and_the_file_runs_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sending: Sending
) -> None:
    saved = tmp_path / "walk.txt"
    sending([b"x"] * 30 + sensagram(run_of()))
    out = tmp_path / "report"
    arguments = ["--udp", "0", "--seconds", "6", "--save", str(saved), "--out", str(out), "--json"]
    assert front.main(["phone", "--board", "native", *arguments]) == 0
    live = json.loads(capsys.readouterr().out)
    assert (live["verdict"], live["steps"]) == ("pass", 600)
    assert re.fullmatch(r"udp:[1-9]\d*", live["source"])
    assert live["received"]["malformed"] == 30 and live["received"]["apps"].keys() == {"SensaGram"}
    assert {file.name for file in out.iterdir()} == {"report.html", "summary.json", "steps.csv"}
    page = (out / "report.html").read_text()
    assert "What arrived" in page and "<td>malformed</td><td>30</td>" in page
    assert json.loads((out / "summary.json").read_text())["received"] == live["received"]

    assert front.main(["replay", str(saved), "--system", "phone", "--board", "native", "--seconds", "6", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert (again["verdict"], again["steps"]) == ("pass", 600)
    assert again["received"]["malformed"] == 30
    rows = (out / "steps.csv").read_text().splitlines()
    at = rows[0].split(",").index("pitch_turn_q32")
    assert int(rows[600].split(",")[at]) * 360.0 / 2**32 == pytest.approx(live["pitch_deg"], abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["--board", "native", "--tuning", "best"], 2),
        (["--board", "native", "--period-us", "100"], 2),
        (["--board", "native", "--period-us", "0"], 2),
        (["--board", "native", "--udp", "70000"], 2),
        (["--board", "native", "--udp", "-5"], 2),
        (["--board", "native", "--seconds", "0"], 2),
        (["--board", "native", "--seconds", "-3"], 2),
        (["--board", "native", "--seconds", "nan"], 2),
        (["--board", "native", "--seconds", "inf"], 2),
        (["--board", "native", "--wait", "0"], 2),
        (["--board", "native", "--wait", "nan"], 2),
        (["--board", "native", "--listen", ""], 2),
        (["--board", "native", "--listen", "nowhere"], 2),
        (["--board", "native", "--listen", "300.1.2.3"], 2),
        (["--board", "native", "--listen", "::1"], 2),
        (["--board", "native", "--out", "/proc/here/not"], 2),
        (["--board", "native", "--save", "/proc/here/not"], 2),
        (["--board", "native", "--listen", "192.0.2.1"], 3),
        (["--board", "native", "--udp", "0", "--wait", "0.2"], 3),
    ],
)
def test_wrong_use_is_one_sentence(arguments: list[str], code: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["phone", *arguments]) == code
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == (2 if "--wait" in arguments and code == 3 else 1)
    assert "Errno" not in lines[-1]
