"""A log recorded from a served virtual board, over its pty, is reproduced in every bit: the whole way of a user."""

from __future__ import annotations

import json
import signal
import subprocess
from pathlib import Path

import pytest

pytest.importorskip("unicorn", reason="the virtual board needs the extra virtual")

from plumb import __main__ as front
from plumb.errors import UsageError
from plumb.flash.image import find_image
from plumb.readers import log_replay
from support import slow_time

try:
    find_image()
except UsageError as missing:
    pytest.skip(str(missing), allow_module_level=True)


def test_a_log_of_a_served_board_is_reproduced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Recorded over the pty with the plant in motion; then from log and BLF on the C core and the image."""
    slow_time.slow_down(monkeypatch)
    port, out = tmp_path / "port", tmp_path / "today"
    command, environment = slow_time.command("virtual-board", "--symlink", str(port), "--system", "quad")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            assert process.stdout is not None and process.stdout.readline()
            record = ["record", "--board", f"serial:{port}", "--run", "live", "--out", str(out), "--format", "blf"]
            assert front.main([*record, "--seconds", "0.6", "--json"]) == 0
        finally:
            process.send_signal(signal.SIGTERM)
    recorded = json.loads(capsys.readouterr().out)
    assert recorded["lost"] == 0 and recorded["steps"] > 15
    log = log_replay.open_log(tmp_path / "today.plog")
    assert log.head["clock"] == "utc" and str(log.head["command"]).startswith("plumb record") and not log.warnings
    for name, board in (("today.plog", "native"), ("today.plog", "virtual"), ("today.blf", "native")):
        assert front.main(["replay", str(tmp_path / name), "--board", board, "--json"]) == 0
        said = json.loads(capsys.readouterr().out)
        assert said["verdict"] == "pass" and said["recorded"]["compared"] == recorded["steps"] == said["steps"]
