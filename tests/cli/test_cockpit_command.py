"""`plumb cockpit` from the command line: its addresses, a page of it, its end, and wrong use."""

from __future__ import annotations

import asyncio
import json
import signal
import subprocess
import sys
from pathlib import Path

import aiohttp
import pytest

from plumb import __main__ as front
from support.declared_systems import lacking

PATIENCE_S = 60.0


async def first_green(address: str) -> dict[str, object]:
    """The first state of the page in which the light is green."""
    origin = "/".join(address.split("/")[:3])
    async with aiohttp.ClientSession() as client:
        async with client.get(address) as answer:
            assert "plumb" in await answer.text()
        async with client.ws_connect(f"{address}live", headers={"Origin": origin}) as page:
            async for message in page:
                if message.type is aiohttp.WSMsgType.TEXT:
                    said = json.loads(message.data)
                    if said.get("light", {}).get("colour") == "green":
                        return dict(said)
    raise AssertionError("the page ended")


@pytest.mark.slow
def test_a_page_of_the_virtual_board_turns_green_and_ctrl_c_ends_it(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "plumb", "cockpit", "--board", "virtual", "--json", "--out", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stderr is not None
        said = json.loads(process.stdout.readline())
        state = asyncio.run(asyncio.wait_for(first_green(said["watch"]), PATIENCE_S))
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130
        assert process.stderr.read() == "plumb: interrupted.\n"
    assert state["may_control"] is False and state["board"] == "virtual"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--board", "native"], "is no board with a link"),
        (["--board", "virtual", "--port", "70000"], "--port 70000"),
        (["--board", "virtual", "--seconds", "0"], "--seconds 0"),
        (["--board", "virtual", "--scenario", "nowhere"], "nowhere"),
        *(
            (["--board", "virtual", "--system", name], f"{name}: the board has no sensors of its own for it")
            for name in lacking("pins")
        ),
    ],
)
def test_wrong_use_is_one_sentence(arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert front.main(["cockpit", *arguments]) == 2
    captured = capsys.readouterr()
    assert sentence in captured.err and len(captured.err.strip().splitlines()) == 1 and not captured.out


def test_without_aiohttp_the_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    assert front.main(["cockpit", "--board", "virtual"]) == 2
    assert "cockpit]'" in capsys.readouterr().err
