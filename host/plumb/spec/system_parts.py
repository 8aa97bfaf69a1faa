"""Load a module of a system's folders and check it against its contract.

A system has two folders: `systems/NAME` with what its step needs, `judging/NAME` with what judges it.

A contract is a Protocol. Those of what every system has are in `plumb.contract`, the others beside the code that uses
the module: `plumb.systems.contracts`, `plumb.proof`, `plumb.cli`. A system is chosen by name at run time,
when no type checker sees its modules; therefore `load` checks them and names everything that is missing.
"""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Generic, Protocol, TypeVar, cast

from plumb.errors import UsageError
from plumb.spec import declarations
from plumb.spec.system import System

P = TypeVar("P", covariant=True)


@dataclass(frozen=True)
class Part(Generic[P]):
    """A module of one of a system's folders.

    name: of its file, without .py. contract: the Protocol P that it implements. without: what a system without this
    part cannot do, for the UsageError; "" for a part that every system must have. place: the folder, `systems` or
    `judging`. defaults: name of the system -> values of the names that a module may leave out.
    """

    name: str
    contract: type
    without: str = ""
    place: str = "systems"
    defaults: Callable[[str], Mapping[str, object]] | None = None

    def path(self, system: System) -> Path:
        """The file, whether the system has it or not."""
        return (system.folder if self.place == "systems" else system.judging) / f"{self.name}.py"


def load(system: str, part: Part[P]) -> P:
    """The part of a system. Raises UsageError for an unknown system, a missing part, and a module that does not fulfil
    the contract."""
    declared = declarations.system(system)
    known = _loaded.get((id(declared), part.place, part.name))
    if known is not None and known[1] is part.contract:
        return cast(P, known[2])
    if not part.path(declared).is_file():
        if declared.shipped and part.without:  # a user of the package cannot add the file
            raise UsageError(f"{system}: {part.without}")
        reason = part.without or "every system has this file: CONTRIBUTING.md, 'Add a system', says what it offers"
        raise UsageError(f"{system} has no {part.name}.py: {reason}")
    module = importlib.import_module(f"plumb.{part.place}.{system}.{part.name}")
    if part.defaults is not None:
        for name, value in part.defaults(system).items():
            vars(module).setdefault(name, value)
    check(module, part.contract)
    _loaded[id(declared), part.place, part.name] = declared, part.contract, module
    return cast(P, module)


_loaded: dict[tuple[int, str, str], tuple[System, type, ModuleType]] = {}
"""What `load` has checked: every run of a campaign asks for the same parts. The declaration stays, and so does its
identity."""


@cache
def check(module: ModuleType, contract: type) -> None:
    """Raises UsageError that names everything the module lacks of the contract."""
    missing = []
    for name, member in members_of(contract).items():
        if not isinstance(member, FunctionType):
            missing += [] if hasattr(module, name) else [name]
        elif not callable(offered := getattr(module, name, None)):
            missing.append(f"{name}()")
        else:
            missing += [f"{keyword} of {name}()" for keyword in _keywords_missing(offered, member)]
    if missing:
        raise UsageError(
            f"{module.__file__} lacks {', '.join(missing)}; CONTRIBUTING.md, 'Add a system', says what it must offer"
        )


def members_of(contract: type) -> dict[str, object]:
    """The public members of a Protocol by name, those of its bases first."""
    kinds = reversed(contract.__mro__[: contract.__mro__.index(cast(type, Protocol))])
    return {name: member for kind in kinds for name, member in vars(kind).items() if not name.startswith("_")}


def _keywords_missing(offered: Callable[..., object], wanted: Callable[..., object]) -> list[str]:
    """Keyword arguments of the contract's function that the module's function does not accept."""
    taken = inspect.signature(offered).parameters.values()
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in taken):
        return []
    names = {parameter.name for parameter in taken}
    keywords = (one.name for one in inspect.signature(wanted).parameters.values() if one.kind is one.KEYWORD_ONLY)
    return [name for name in keywords if name not in names]
