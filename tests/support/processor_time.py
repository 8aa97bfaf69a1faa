"""A pytest plugin: the processor time of every test, its children included, in build/test-times.json.

`make test-times` shows it (tools/test_times.py). Wall time depends on what else runs, processor time hardly. The time
of a fixture counts for the test that it was made for first.
"""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Generator
from pathlib import Path

import pytest

TIMES = Path(__file__).resolve().parents[2] / "build" / "test-times.json"
NAME = "processor_s"
_begin_s = pytest.StashKey[float]()
_times_s: dict[str, float] = {}


def _used_s() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    item.stash[_begin_s] = _used_s()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if call.when == "teardown" and _begin_s in item.stash:
        report.user_properties.append((NAME, _used_s() - item.stash[_begin_s]))
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """In the process that hears of all tests."""
    for name, value in report.user_properties:
        if name == NAME:
            _times_s[report.nodeid] = float(str(value))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Only of a run of all tests: a part does not replace the times of the whole."""
    whole = not session.config.args or session.config.args == session.config.getini("testpaths")
    if not hasattr(session.config, "workerinput") and whole and _times_s:
        TIMES.parent.mkdir(exist_ok=True)
        TIMES.write_text(json.dumps(_times_s, indent=0), encoding="utf-8")
