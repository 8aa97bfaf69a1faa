"""Snapshots of a machine and of all objects it refers to; a snapshot can be restored any number of times.

A snapshot follows references from its roots: attributes, containers, bound methods, closures. Every attribute of every
object it reaches counts as state and is restored in place, so that object identities stay and a new peripheral cannot
be forgotten. Exceptions are declared: a class lists in WIRING the attributes that never change after construction or
that refer to state outside Python; these are not followed. An object with state outside Python (the registers inside
Unicorn) has a method `keep()`, which returns a function that restores this state.

A value that cannot be copied (a generator, a file, a lock) raises SimulationError, which names its place.
"""

from __future__ import annotations

import functools
import random
import re
import struct
from collections import deque
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import PurePath
from types import BuiltinFunctionType, CellType, FunctionType, MethodType, ModuleType, NoneType
from typing import Any

import numpy as np

from plumb.f103.core.bus import SimulationError

_CONSTANT = (
    bool, int, float, complex, str, bytes, NoneType, type, ModuleType, Enum, PurePath, re.Pattern, range, slice,
    np.generic, np.dtype, struct.Struct,
)  # fmt: skip
_EMPTY = object()
"""Content of a closure's cell whose variable is not assigned yet."""


def wiring(kind: type) -> frozenset[str]:
    """Attributes that this class and its base classes list in WIRING."""
    return frozenset().union(*(vars(base).get("WIRING", ()) for base in kind.__mro__))


class Snapshot:
    """The present state of all objects reached from `roots`. restore() puts it back; later objects are dropped."""

    def __init__(self, *roots: object) -> None:
        self._kept: list[Callable[[], None]] = []
        self._outside: list[Callable[[], None]] = []
        self._seen: dict[int, object] = {}
        self.reached: list[object] = []
        """Every object with attributes whose state is kept."""
        self._follow(roots)

    def restore(self) -> None:
        """Put everything back, in place."""
        for put_back in self._outside + self._kept:
            put_back()

    def _follow(self, roots: tuple[object, ...]) -> None:
        waiting = [(f"root {number}", root) for number, root in enumerate(roots)]
        while waiting:
            place, value = waiting.pop()
            if isinstance(value, _CONSTANT) or id(value) in self._seen:
                continue
            self._seen[id(value)] = value  # referenced, so that its id() is not reused
            waiting += [(place + step, part) for step, part in self._keep(value, place)]

    def _keep(self, value: Any, place: str) -> Iterator[tuple[str, object]]:
        """Keep the state of one object; yields the objects it refers to, each with the step that leads there."""
        if isinstance(value, tuple | frozenset):
            yield from ((f"[{i}]", part) for i, part in enumerate(value))
        elif isinstance(value, FunctionType):
            yield from self._keep_closure(value)
        elif isinstance(value, MethodType):
            yield ".__self__", value.__self__
            yield ".__func__", value.__func__
        elif isinstance(value, BuiltinFunctionType):
            yield ".__self__", value.__self__
        elif isinstance(value, functools.partial):
            yield "()", (value.func, value.args, value.keywords)
        elif isinstance(value, CellType):
            yield from self._keep_cell(value)
        elif isinstance(value, memoryview | np.ndarray):
            self._keep_memory(value)
        elif isinstance(value, random.Random):
            state = value.getstate()
            self._kept.append(lambda: value.setstate(state))
        else:
            yield from self._keep_object(value, place)

    def _keep_closure(self, function: FunctionType) -> Iterator[tuple[str, object]]:
        names = function.__code__.co_freevars
        yield from zip((f" of {name}" for name in names), function.__closure__ or (), strict=True)
        yield "()", (function.__defaults__, function.__kwdefaults__)

    def _keep_cell(self, cell: CellType) -> Iterator[tuple[str, object]]:
        try:
            content = cell.cell_contents
        except ValueError:
            content = _EMPTY

        def put_back() -> None:
            if content is not _EMPTY:
                cell.cell_contents = content

        self._kept.append(put_back)
        if content is not _EMPTY:
            yield "", content

    def _keep_memory(self, memory: memoryview | np.ndarray[Any, Any]) -> None:
        writable = not memory.readonly if isinstance(memory, memoryview) else memory.flags.writeable
        if not writable:
            return
        content: Any = bytes(memory) if isinstance(memory, memoryview) else memory.copy()

        def put_back() -> None:
            memory[:] = content

        self._kept.append(put_back)

    def _keep_object(self, value: Any, place: str) -> Iterator[tuple[str, object]]:
        kind = type(value)
        container = isinstance(value, list | deque | dict | set | bytearray)
        attributes = getattr(value, "__dict__", None)
        slots = [name for base in kind.__mro__ for name in _slots_of(base) if hasattr(value, name)]
        if not container and attributes is None and not slots and kind is not object:
            raise SimulationError(
                f"a snapshot cannot keep the {kind.__name__} at {place}: make it plain state, or name it in WIRING"
            )
        if container:
            yield from self._keep_container(value)
        if hasattr(kind, "keep"):
            self._outside.append(value.keep())
        if attributes is not None or slots:
            self.reached.append(value)
        ignored = wiring(kind)
        for name in slots:
            part = getattr(value, name)
            self._kept.append(functools.partial(object.__setattr__, value, name, part))
            if name not in ignored:
                yield f".{name}", part
        if attributes is not None:
            kept = dict(attributes)
            self._kept.append(lambda: _refill(attributes, kept))
            yield from ((f".{name}", part) for name, part in kept.items() if name not in ignored)

    def _keep_container(self, value: Any) -> Iterator[tuple[str, object]]:
        if isinstance(value, bytearray):
            content: Any = bytes(value)

            def put_bytes() -> None:
                value[:] = content

            self._kept.append(put_bytes)
        elif isinstance(value, dict):
            content = dict(value)
            self._kept.append(lambda: _refill(value, content))
            yield from ((f"[{key!r}]", part) for key, part in content.items())
            yield "{}", tuple(content)
        elif isinstance(value, set):
            content = set(value)

            def put_set() -> None:
                value.clear()
                value.update(content)

            self._kept.append(put_set)
            yield "{}", frozenset(content)
        else:
            content = list(value)

            def put_list() -> None:
                value.clear()
                value.extend(content)

            self._kept.append(put_list)
            yield from ((f"[{i}]", part) for i, part in enumerate(content))


def _refill(values: dict[Any, Any], content: dict[Any, Any]) -> None:
    """Restore content and order of a dict, bypassing methods that a subclass overrides."""
    dict.clear(values)
    dict.update(values, content)


def _slots_of(base: type) -> tuple[str, ...]:
    slots = vars(base).get("__slots__", ())
    return (
        (slots,) if isinstance(slots, str) else tuple(name for name in slots if name not in ("__dict__", "__weakref__"))
    )
