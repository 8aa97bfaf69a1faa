"""A pytest plugin: processor and wall time of every test, its children included, in build/test-times.json.

`make test-times` shows both (tools/test_times.py). Processor time hardly depends on what else runs; wall time beyond it
is time in which the test waited. The time of a fixture counts for the test that it was made for first.
"""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Generator
from pathlib import Path
from typing import NamedTuple

import pytest

TIMES = Path(__file__).resolve().parents[2] / "build" / "test-times.json"
NAME = "times_s"


class Times(NamedTuple):
    """s."""

    processor: float
    wall: float


_begin = pytest.StashKey[Times]()
_times_s: dict[str, list[float]] = {}


def _now() -> Times:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Times(time.process_time() + children.ru_utime + children.ru_stime, time.monotonic())


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    item.stash[_begin] = _now()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if call.when == "teardown" and _begin in item.stash:
        begin, end = item.stash[_begin], _now()
        report.user_properties.append((NAME, [end.processor - begin.processor, end.wall - begin.wall]))
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """In the process to which all tests report."""
    for name, value in report.user_properties:
        if name == NAME and isinstance(value, list):
            _times_s[report.nodeid] = value


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Only of a run of all tests: a part does not replace the times of the whole."""
    whole = not session.config.args or session.config.args == session.config.getini("testpaths")
    if not hasattr(session.config, "workerinput") and whole and _times_s:
        TIMES.parent.mkdir(exist_ok=True)
        TIMES.write_text(json.dumps(_times_s), encoding="utf-8")
