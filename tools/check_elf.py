#!/usr/bin/env python3
"""Check a linked Arm image: no soft float, no library division, no heap, no recursion, no call through a pointer, and
worst-case stack, flash and RAM within their budgets.

Exit code 0: all checks pass. 1: a check fails; each finding is a sentence. 2: the image cannot be examined.
"""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "host"))

from plumb.errors import PlumbError
from plumb.flash.call_graph import CallGraph
from plumb.flash.left_out import advice

_FLOATS = r"(add|sub|mul|div|neg|cmp|eq|ne|lt|le|gt|ge|unord|fix|fixuns|float|floatun|floatuns|extend|trunc|pow)"
_FORBIDDEN = {
    "soft float": rf"__aeabi_(f|d|cf|cd)(r?sub|add|mul|div|neg|r?cmp\w*|2\w+)|__aeabi_(i|ui|l|ul|h)2[fd]|"
    rf"__{_FLOATS}[hsdtx][fi]\w*[23]?|__ieee754_\w+",
    "library division": r"__aeabi_(u?idiv(mod)?|u?ldivmod)|__u?(div|mod|divmod)[sdt]i[34]|__aeabi_[il]div0",
    "the heap": r"_?(malloc|calloc|realloc|free)(_r)?|_?sbrk(_r)?",
}


def findings(
    path: Path, flash_budget: int | None = None, ram_budget: int | None = None, stack_reserve: int | None = None
) -> tuple[list[str], dict[str, int]]:
    """The findings, one sentence each, and the sizes in bytes: flash, ram, stack. A limit that is None is the image's
    own, as its symbols say."""
    graph = CallGraph(path)
    if flash_budget is None or ram_budget is None or stack_reserve is None:
        own = graph.elf.limits
        flash_budget = own["flash"] if flash_budget is None else flash_budget
        ram_budget = own["ram"] if ram_budget is None else ram_budget
        stack_reserve = own["stack"] if stack_reserve is None else stack_reserve
    wrong = []
    for what, pattern in _FORBIDDEN.items():
        found = sorted(name for name in graph.elf.symbols if re.fullmatch(pattern, name))
        if found:
            callers = sorted(
                f.name
                for f in graph.functions.values()
                if any(graph.name(callee) in found for callee in f.calls) and f.name not in found
            )
            by = f", called by {', '.join(callers[:4])}" if callers else ""
            wrong.append(f"{path.name} contains {what}: {', '.join(found[:4])}{by}.")
    for function in graph.functions.values():
        for address in function.indirect[:1]:
            wrong.append(f"{function.name} calls through a pointer at 0x{address:08x}: its stack cannot be bounded.")
        for address in function.unbounded[:1]:
            wrong.append(f"{function.name} moves the stack pointer by an unknown amount at 0x{address:08x}.")
    sizes = {"flash": graph.elf.flash_bytes, "ram": graph.elf.ram_bytes, "stack": 0}
    chain = graph.recursion()
    if chain:
        wrong.append(f"{path.name} recurses: {' -> '.join(chain)}.")
        return wrong, sizes
    sizes["stack"] = graph.worst_stack_bytes()
    over = sizes["flash"] - flash_budget
    if over > 0:
        wrong.append(
            f"{path.name} takes {sizes['flash']} bytes of flash, {over} more than the {flash_budget} that it may take; "
            f"{advice(graph)}."
        )
    stack = max(sizes["stack"], graph.elf.reserved_stack_bytes)
    over = sizes["ram"] + stack - ram_budget
    if over > 0:
        wrong.append(
            f"{path.name} takes {sizes['ram']} bytes of RAM and {stack} of stack, {over} more than the "
            f"{ram_budget} that it may take; {advice(graph)}."
        )
    if sizes["stack"] > stack_reserve:
        wrong.append(f"{path.name} may need {sizes['stack']} bytes of stack, {stack_reserve} are reserved.")
    return wrong, sizes


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("image", type=Path)
    own = "; without it the linker script's"
    parser.add_argument("--flash", type=int, metavar="BYTES", help=f"flash that the image may take{own}")
    parser.add_argument("--ram", type=int, metavar="BYTES", help=f".data, .bss and the worst-case stack together{own}")
    parser.add_argument("--stack", type=int, metavar="BYTES", help=f"stack that is reserved{own}")
    options = parser.parse_args()
    try:
        wrong, sizes = findings(options.image, options.flash, options.ram, options.stack)
    except PlumbError as error:
        print(f"check_elf: {error}", file=sys.stderr)
        return error.exit_code
    for sentence in wrong:
        print(f"check_elf: {sentence}", file=sys.stderr)
    print(
        f"{options.image.name}: flash {sizes['flash']}, ram {sizes['ram']}, worst-case stack {sizes['stack']} bytes; "
        + ("not as promised" if wrong else "no soft float, library division, heap, recursion or pointer calls")
    )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
