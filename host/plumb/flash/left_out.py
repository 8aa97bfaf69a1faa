"""Flash that an image would save without one of its systems, by its call graph."""

from __future__ import annotations

from plumb.flash.call_graph import CallGraph
from plumb.spec import declarations

ENTRIES = ("init", "step", "params_valid", "plausibility", "retune")
"""Functions of a system that the dispatch calls: plumb_NAME_init() and so on."""
LOOKUP, LOOKUP_BYTES = "place_of", 448
"""Function of generated/params.c by which an image finds parameters when it holds a part of the table; and the most
bytes that it and similar functions take. An image of all systems does not need it."""


def systems_in(graph: CallGraph) -> list[str]:
    """The systems whose steps the image holds, by their symbols: its own, and those that these build on."""
    return [name for name in declarations.names() if f"plumb_{name}_step" in graph.elf.symbols]


def saved_bytes(graph: CallGraph, system: str) -> int:
    """Flash of the functions that only this system reaches, minus LOOKUP_BYTES where the image then needs LOOKUP; 0
    where another system builds on it. Constants and initial values come on top."""
    if any(system in declarations.system(name).stands_on for name in systems_in(graph)):
        return 0
    entries = {f"plumb_{system}_{entry}" for entry in ENTRIES}
    closed = {at for at, function in graph.functions.items() if function.name in entries}
    handlers = graph.elf.vectors()
    alone = graph.reachable(*handlers) - graph.reachable(*handlers, closed=closed)
    code = sum(symbol.size for symbol in graph.elf.functions if symbol.address in alone)
    return code if LOOKUP in graph.elf.symbols else max(code - LOOKUP_BYTES, 0)


def advice(graph: CallGraph) -> str:
    """Systems to leave out of an image that is over its limits, as the end of a sentence."""
    saved = sorted(((saved_bytes(graph, name), name) for name in systems_in(graph)), reverse=True)
    each = [f"{name} ({size} bytes of code)" for size, name in saved if size]
    if len(each) < 2:
        return f"tools/size_table.py {graph.elf.path.name} --functions says what takes them"
    return f"leave out one of {', '.join(each)}: -DPLUMB_SYSTEMS=NAMES names those to keep"
