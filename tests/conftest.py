"""No test waits for ever: one that takes longer than LIMIT_S fails, and shows what every thread was doing.

Where no Python runs any more to fail the test, the whole session ends after twice that, with the same account.
"""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from collections.abc import Iterator

import pytest

LIMIT_S = float(os.environ.get("PLUMB_TEST_LIMIT_S", "300"))
"""For set-up, test and tear-down each. The longest takes some ten seconds on an idle machine."""

_terminal = pytest.StashKey[int]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_terminal] = os.dup(sys.__stderr__.fileno() if sys.__stderr__ else 2)  # not captured yet


def pytest_unconfigure(config: pytest.Config) -> None:
    os.close(config.stash[_terminal])


def _limited(item: pytest.Item) -> Iterator[None]:
    def too_long(*_: object) -> None:
        faulthandler.dump_traceback(item.config.stash[_terminal])
        pytest.fail(f"{item.nodeid} is not done after {LIMIT_S:g} s")

    before = signal.signal(signal.SIGALRM, too_long)
    signal.setitimer(signal.ITIMER_REAL, LIMIT_S)
    faulthandler.dump_traceback_later(2 * LIMIT_S, exit=True, file=item.config.stash[_terminal])
    try:
        return (yield)
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    return (yield from _limited(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    return (yield from _limited(item))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Iterator[None]:
    return (yield from _limited(item))
