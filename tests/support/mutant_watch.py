"""Call mutants of the core together with the core, in one run of the tests: a pytest plugin.

    PLUMB_MUTANTS=one.so:two.so PLUMB_MUTANTS_REPORT=report.txt pytest -p support.mutant_watch TESTS

What a test calls in `plumb.boards.native.core` is called with each library, too, on the same inputs. The test sees the
core's answer alone. PLUMB_MUTANTS_REPORT gets a line, the library and the test, for the first tests in which a library
answers otherwise.
"""

from __future__ import annotations

import ctypes
import inspect
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
import pytest

from plumb.boards.native import core as native_core

MUTANTS_VARIABLE, REPORT_VARIABLE = "PLUMB_MUTANTS", "PLUMB_MUTANTS_REPORT"
MOST_TESTS = 3
"""After so many reported tests a library is called no more."""
NO_ANSWER = frozenset({"c_core", "core_path", "kalman_steps_per_s", "require_valid", "word_names"})
"""Functions that load and check the core, or take its time."""
CLASSES = (native_core.Controller, native_core.Controllers)


class Mutants:
    """The libraries, and which of them is called now; None: the core."""

    def __init__(self, paths: list[str], report: Path) -> None:
        self.libraries = {path: ctypes.CDLL(path) for path in paths}
        for library in self.libraries.values():
            library.plumb_word_names.restype = ctypes.c_char_p
            library.plumb_crc32.restype = ctypes.c_uint32
        self.report, self.test, self.noted = report, "", dict[str, list[str]]()
        self.core, self.called = native_core.c_core, dict[str, ctypes.CDLL]()

    def c_core(self) -> ctypes.CDLL:
        """What takes the place of `native_core.c_core`."""
        return next(iter(self.called.values()), None) or self.core()

    @contextmanager
    def calling(self, path: str) -> Iterator[None]:
        self.called[path] = self.libraries[path]
        try:
            yield
        finally:
            self.called.clear()

    def answer(self, path: str, call: Callable[[], object]) -> object:
        """The answer of a library; the exception that it ends in."""
        with self.calling(path):
            try:
                return call()
            except Exception as error:  # whatever the core does not do is another answer
                return error

    def note(self, path: str) -> None:
        tests = self.noted.setdefault(path, [])
        if self.test not in tests:
            tests.append(self.test)
            with self.report.open("a", encoding="utf-8") as file:
                file.write(f"{path}\t{self.test}\n")
        if len(tests) >= MOST_TESTS:
            del self.libraries[path]

    def alongside(self, function: Callable[..., object]) -> Callable[..., object]:
        """The function, which calls all libraries on its way."""

        def called(*given: Any, **named: Any) -> object:
            result = function(*given, **named)
            if not self.called:
                wanted = content(result)
                for path in list(self.libraries):
                    if content(self.answer(path, lambda: function(*given, **named))) != wanted:
                        self.note(path)
            return result

        return called

    def shadowed(self, kind: type) -> type:
        """A class each of whose objects has one of every library behind it, which does what it does."""
        outer = self

        def begin(this: Any, *given: Any, **named: Any) -> None:
            kind.__init__(this, *given, **named)  # type: ignore[misc]
            made = {} if outer.called else {path: outer.answer(path, lambda: kind(*given)) for path in outer.libraries}
            this.shadows = {path: one for path, one in made.items() if isinstance(one, kind)}
            for path in made.keys() - this.shadows.keys():
                outer.note(path)

        def doing(method: Callable[..., object]) -> Callable[..., object]:
            def called(this: Any, *given: Any, **named: Any) -> object:
                result = method(this, *given, **named)
                wanted = content(result)
                for path in [path for path in this.shadows if path in outer.libraries]:
                    shadow = this.shadows[path]
                    if content(outer.answer(path, lambda one=shadow: method(one, *given, **named))) != wanted:  # type: ignore[misc]
                        outer.note(path)
                        del this.shadows[path]
                return result

            return called

        methods = {name: one for name, one in vars(kind).items() if isinstance(one, FunctionType) and name[0] != "_"}
        return type(kind.__name__, (kind,), {"__init__": begin, **{name: doing(methods[name]) for name in methods}})


def content(answer: object) -> bytes:
    """All bits of an answer."""
    if isinstance(answer, tuple):
        return b"|".join(map(content, answer))
    if isinstance(answer, np.ndarray):
        return answer.tobytes()
    record = getattr(answer, "record", None)
    return record.tobytes() if isinstance(record, np.ndarray) else repr(answer).encode()


def watched(mutants: Mutants) -> None:
    """Add the libraries to the core of this process."""
    native_core.c_core = mutants.c_core  # type: ignore[assignment]
    mutants.c_core.__func__.cache_clear = mutants.core.cache_clear  # type: ignore[attr-defined]
    for name, function in inspect.getmembers(native_core, inspect.isfunction):
        if function.__module__ == native_core.__name__ and name[0] != "_" and name not in NO_ANSWER:
            setattr(native_core, name, mutants.alongside(function))
    for kind in CLASSES:
        setattr(native_core, kind.__name__, mutants.shadowed(kind))


MUTANTS = Mutants(os.environ[MUTANTS_VARIABLE].split(os.pathsep), Path(os.environ[REPORT_VARIABLE]))
watched(MUTANTS)


def pytest_runtest_setup(item: pytest.Item) -> None:
    MUTANTS.test = item.nodeid
