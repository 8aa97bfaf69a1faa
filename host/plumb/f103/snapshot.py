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
import operator
import random
import re
import struct
from collections import deque
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import PurePath
from types import BuiltinFunctionType, CellType, FunctionType, MethodType, ModuleType, NoneType
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

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


@runtime_checkable
class _Outside(Protocol):
    """An object with state outside Python."""

    def keep(self) -> Callable[[], None]:
        """A function that restores this state."""


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

    def _keep(self, value: object, place: str) -> Iterator[tuple[str, object]]:
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

    def _keep_memory(self, memory: memoryview | npt.NDArray[np.generic]) -> None:
        if isinstance(memory, memoryview):
            if not memory.readonly:
                self._kept.append(functools.partial(operator.setitem, memory, slice(None), bytes(memory)))
        elif memory.flags.writeable:
            self._kept.append(functools.partial(operator.setitem, memory, ..., memory.copy()))

    def _keep_object(self, value: object, place: str) -> Iterator[tuple[str, object]]:
        kind = type(value)
        attributes = getattr(value, "__dict__", None)
        slots = [name for base in kind.__mro__ for name in _slots_of(base) if hasattr(value, name)]
        container = value if isinstance(value, list | deque | dict | set | bytearray) else None
        if container is None and attributes is None and not slots and kind is not object:
            raise SimulationError(
                f"a snapshot cannot keep the {kind.__name__} at {place}: make it plain state, or name it in WIRING"
            )
        if container is not None:
            yield from self._keep_container(container)
        if isinstance(value, _Outside):
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

    def _keep_container(
        self, value: list[object] | deque[object] | dict[object, object] | set[object] | bytearray
    ) -> Iterator[tuple[str, object]]:
        if isinstance(value, bytearray):
            self._kept.append(functools.partial(operator.setitem, value, slice(None), bytes(value)))
        elif isinstance(value, dict):
            entries = dict(value)
            self._kept.append(functools.partial(_refill, value, entries))
            yield from ((f"[{key!r}]", part) for key, part in entries.items())
            yield "{}", tuple(entries)
        elif isinstance(value, set):
            members = frozenset(value)
            self._kept += [value.clear, functools.partial(value.update, members)]
            yield "{}", members
        else:
            parts = tuple(value)
            self._kept += [value.clear, functools.partial(value.extend, parts)]
            yield from ((f"[{i}]", part) for i, part in enumerate(parts))


def _refill(values: dict[object, object], content: dict[object, object]) -> None:
    """Restore content and order of a dict, bypassing methods that a subclass overrides."""
    dict.clear(values)
    dict.update(values, content)


def _slots_of(base: type) -> tuple[str, ...]:
    slots = vars(base).get("__slots__", ())
    return (
        (slots,) if isinstance(slots, str) else tuple(name for name in slots if name not in ("__dict__", "__weakref__"))
    )
