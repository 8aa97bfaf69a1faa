"""What holds for every test: a limit of time, that a skip which nobody wrote down is a failure, and that those marked
`long` run with PLUMB_LONG=1 only.

A test that takes longer than LIMIT_S fails, and shows what every thread was doing. Where no Python runs any more to
fail the test, its process ends after about twice that, with the same account: the whole session, or one of its workers.
"""

from __future__ import annotations

import faulthandler
import gc
import math
import os
import re
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Generator
from fnmatch import fnmatch
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from plumb.link.transports.slcan_bus import PlumbBus

LIMIT_S = float(os.environ.get("PLUMB_TEST_LIMIT_S", "300"))
"""For set-up, test and tear-down each. The longest takes some ten seconds on an idle machine."""

NO_SKIPS = os.environ.get("PLUMB_NO_SKIPS") == "1"
"""Set by the Makefile, which has built and installed all that a test may ask for."""

MAY_SKIP = [
    ("tests/*", r"PLUMB_DATA"),  # recordings with an optical reference, which are not part of the repository
    ("tests/*", r"\bno (/dev/full|/dev/zero|/proc)\b|only Linux|no limit of file size"),  # other operating systems
    ("tests/proof/test_report_browser.py", r"no browser"),  # half a gigabyte, which only this file would need
]
"""Files, as a pattern, and reasons, as a regular expression: what may be skipped all the same."""

CALLERS: dict[signal.Signals, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
"""Signals that a caller may have ignored or blocked, as a shell does for what it runs behind `&`. Processes inherit
that, and tests of how plumb ends would wait in vain."""

_terminal = pytest.StashKey[int]()
_watched_s = pytest.StashKey[float]()
"""Monotonic time at which the end of the process was last put off."""


def _leave(bus: PlumbBus) -> None:
    """A bus that a test drops open is just dropped. python-can would close it, which sends C and disarms, whenever
    Python collects it: perhaps while a later test drives the same machine."""


def pytest_configure(config: pytest.Config) -> None:
    for number, handler in CALLERS.items():
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, CALLERS)
    for place in ("CONFIG", "STATE", "RUNTIME"):  # not the settings and the boards of whoever runs the tests
        name = f"XDG_{place}_HOME" if place != "RUNTIME" else "XDG_RUNTIME_DIR"
        os.environ[name] = tempfile.mkdtemp(prefix="plumb-tests-")
        config.add_cleanup(partial(shutil.rmtree, os.environ[name], ignore_errors=True))
    PlumbBus.__del__ = _leave  # type: ignore[method-assign, assignment]
    config.stash[_terminal] = os.dup(sys.__stderr__.fileno() if sys.__stderr__ else 2)  # not captured yet


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the files in this folder: they build the package and start pytest anew, and at the end of a run one
    worker would wait for the other. Then by path, whichever folder this worker has collected first."""
    long = [item for item in items if item.get_closest_marker("long")] if os.environ.get("PLUMB_LONG") != "1" else []
    if long:
        config.hook.pytest_deselected(items=long)
    here = Path(__file__).parent
    away = set(long)
    left = [item for item in items if item not in away]
    items[:] = sorted(left, key=lambda item: (item.path.parent != here, item.path))


def pytest_collection_finish() -> None:
    """Some ten thousand collected tests live as long as the process: the garbage collector, which would look at all of
    them again and again, leaves them out, and comes less often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


def pytest_unconfigure(config: pytest.Config) -> None:
    signal.setitimer(signal.ITIMER_REAL, 0)
    _watch_no_longer(config)
    os.close(config.stash[_terminal])


def _watch(config: pytest.Config) -> None:
    """Put off the end of the process, unless that was done a moment ago: faulthandler waits for a thread to end, which
    takes 16 ms on a busy machine, and there are three phases of each of ten thousand tests."""
    now_s = time.monotonic()
    if now_s - config.stash.get(_watched_s, -math.inf) > LIMIT_S / 10.0:
        faulthandler.dump_traceback_later(2 * LIMIT_S, exit=True, file=config.stash[_terminal])
        config.stash[_watched_s] = now_s


def _watch_no_longer(config: pytest.Config, *_: object) -> None:
    """At the end, and when a worker has had nothing to do for a while."""
    faulthandler.cancel_dump_traceback_later()
    config.stash[_watched_s] = -math.inf


def _limited(item: pytest.Item) -> Generator[None, Any, Any]:
    def too_long(*_: object) -> None:
        faulthandler.dump_traceback(item.config.stash[_terminal])
        pytest.fail(f"{item.nodeid} is not done after {LIMIT_S:g} s")

    signal.signal(signal.SIGALRM, too_long)
    signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    _watch(item.config)
    try:
        return (yield)
    finally:
        signal.setitimer(signal.ITIMER_REAL, LIMIT_S / 2.0)
        signal.signal(signal.SIGALRM, partial(_watch_no_longer, item.config))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, Any, Any]:
    return (yield from _limited(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    return (yield from _limited(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, Any, Any]:
    return (yield from _limited(item))


def _forbid_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Turn a skip into a failure, unless MAY_SKIP has it. An expected failure is reported as skipped and is none."""
    if not NO_SKIPS or not report.skipped or hasattr(report, "wasxfail"):
        return
    why = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if not any(fnmatch(report.nodeid, files) and re.search(reason, why) for files, reason in MAY_SKIP):
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid}: {why}. MAY_SKIP in tests/conftest.py does not have it."


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    _forbid_skip(report)
    return report


def _begin_elsewhere(collector: pytest.Directory, found: list[pytest.Item | pytest.Collector]) -> None:
    """Let each worker begin with another part of a folder: what one has compiled, the others read from its cache. All
    of them would else compile every file of a fresh clone at the same time, which takes longer than to import it."""
    worker = getattr(collector.config, "workerinput", None)
    if worker is not None:
        first = len(found) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
        found[:] = found[first:] + found[:first]


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    _forbid_skip(report)
    if isinstance(collector, pytest.Directory) and report.result is not None:
        _begin_elsewhere(collector, report.result)
    return report
