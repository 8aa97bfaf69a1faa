"""Worker processes of the table of figures: SIGINT does nothing there, SIGTERM ends them without a traceback."""

from __future__ import annotations

import signal
from typing import Any

import pytest

from plumb import process_signals
from plumb.proof import figures


def handlers(_task: object) -> list[Any]:
    return [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]


def test_a_worker_does_not_inherit_the_signal_handlers_of_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "_section", handlers)
    before = signal.signal(signal.SIGTERM, process_signals.raise_at_once)
    try:
        rows = list[Any](row for _, row in figures.compute(["quad"], [1000]))
    finally:
        signal.signal(signal.SIGTERM, before)
    assert set(rows) == {signal.SIG_IGN, signal.SIG_DFL}
