"""Print a shell completion script: commands, options, and their values.

    plumb completion bash > ~/.local/share/bash-completion/completions/plumb
    plumb completion zsh  > a file named _plumb in a folder of your fpath
    plumb completion fish > ~/.config/fish/completions/plumb.fish

Systems, scenarios, tunings and files are completed from the script. Boards, buses and ports are those that are there
when you press TAB, and parameters those of the installed plumb: the script asks `plumb completion values KIND`, which
opens no port.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

KINDS = ("board", "bus", "port", "parameter", "assignment", "setting")
"""Kinds of values that are looked up when TAB is pressed."""
OPTIONS = {"--board": "board", "--bus": "bus"}
BY_METAVAR = {("flash", "PORT"): "port", ("setup", "PORT"): "port", ("settings", "NAME=VALUE"): "setting"}
"""(command, metavar) -> kind, before that of the metavar alone."""
METAVARS = {"B": "board", "BUS": "bus", "NAME=VALUE": "assignment"}
BASH = """\
_plumb_values() { plumb completion values "$1" 2>/dev/null; }
"""
BASH_END = """
# bash takes serial:/dev/ttyUSB0 and NAME=VALUE for several words: join them, and give back the end that it asks for.
_plumb() {
  local -a COMP_WORDS=()
  local line="${COMP_LINE:0:$COMP_POINT}"
  read -ra COMP_WORDS <<< "$line"
  [[ "$line" == *[[:space:]] ]] && COMP_WORDS+=("")
  local COMP_CWORD=$(( ${#COMP_WORDS[@]} - 1 )) reply
  _shtab_plumb
  local word="${COMP_WORDS[COMP_CWORD]}"
  local head="${word%"${word##*[:=]}"}"
  for reply in "${!COMPREPLY[@]}"; do
    [[ "${COMPREPLY[reply]}" == *= ]] && compopt -o nospace 2>/dev/null
    COMPREPLY[reply]="${COMPREPLY[reply]#"$head"}"
  done
}
complete -o bashdefault -F _plumb plumb
"""
ZSH = """\
_plumb_values() {
  local -a values  # _arguments puts options of its own before the kind
  values=("${(@f)$(plumb completion values ${@[-1]} 2>/dev/null)}")
  compadd -S '' -a values
}
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=("bash", "zsh", "fish", "tcsh", "values"))
    parser.add_argument("kind", nargs="?", choices=KINDS, metavar="KIND", help=f"with values: {', '.join(KINDS)}")


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError

    if (arguments.shell == "values") != (arguments.kind is not None):
        raise UsageError(f"write `plumb completion SHELL`, or `plumb completion values KIND` with {', '.join(KINDS)}")
    if arguments.kind is not None:
        print("\n".join(values(arguments.kind)))
        return 0
    print(script(arguments.shell))
    return 0


def script(shell: str) -> str:
    import shtab

    from plumb.cli.verbs import command_module, commands

    whole = argparse.ArgumentParser(prog="plumb")
    verbs = whole.add_subparsers()
    for name, text in commands().items():
        parser = verbs.add_parser(name, help=text)
        command_module(name).add_arguments(parser)
        complete_values(name, parser)
    preamble = {"bash": "\n".join([BASH, *map(bash_function, KINDS)]), "zsh": ZSH}
    text = str(shtab.complete(whole, shell=shell, preamble=preamble.get(shell, "")))
    return text + BASH_END if shell == "bash" else text


def bash_function(kind: str) -> str:
    return f'_plumb_{kind}() {{ compgen -W "$(_plumb_values {kind})" -- "$1"; }}'


def complete_values(command: str, parser: argparse.ArgumentParser) -> None:
    """Give every argument without choices the values that it can have."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for inner in action.choices.values():
                complete_values(command, inner)
        elif action.nargs != 0 and not action.choices:
            _complete(command, action)


def _complete(command: str, action: argparse.Action) -> None:
    option = action.option_strings[-1] if action.option_strings else ""
    shown = action.metavar if isinstance(action.metavar, str) else action.dest.upper()
    kind = OPTIONS.get(option) or BY_METAVAR.get((command, shown)) or METAVARS.get(shown)
    if command == "params" and action.dest == "names":
        kind = "parameter"
    if kind is not None:
        functions = {"bash": f"_plumb_{kind}", "zsh": f"_plumb_values {kind}"}
        action.complete = {**functions, "fish": f"(plumb completion values {kind})"}  # type: ignore[attr-defined]
    elif (named := FIXED.get(option) or FIXED.get(shown)) is not None:
        action.choices = tuple(dict.fromkeys(named()))
    elif action.type is Path:
        from shtab import DIRECTORY, FILE

        action.complete = DIRECTORY if shown == "DIR" else FILE  # type: ignore[attr-defined]


def system_names() -> Iterable[str]:
    from plumb.spec import declarations

    return declarations.names()


def scenario_names() -> Iterator[str]:
    from plumb import systems

    for name in system_names():
        yield from systems.load(name).SCENARIOS


def parameter_names() -> list[str]:
    """The short names of the parameters of all systems, in units."""
    from plumb import systems
    from plumb.tuning import quantities

    found: dict[str, None] = {}
    for name in system_names():
        tuning = next(iter(systems.load(name).TUNINGS.values()))
        found |= dict.fromkeys(one.alias for one in quantities.quantities_of_type(type(tuning)).values())
    return list(found)


def tuning_names() -> Iterator[str]:
    from plumb import systems

    for name in system_names():
        yield from systems.load(name).TUNINGS


FIXED: dict[str, Callable[[], Iterable[str]]] = {
    "SYSTEM": system_names,
    "--system": system_names,
    "--scenario": scenario_names,
    "--tuning": tuning_names,
    "TUNING": tuning_names,
}
"""Option or metavar -> the values that the installed plumb has."""


def values(kind: str) -> list[str]:
    """The present values of this kind."""
    from plumb.files import settings
    from plumb.link.can_interfaces import network_interfaces
    from plumb.link.discovery import serial_ports
    from plumb.link.served_boards import served_boards

    if kind in ("parameter", "assignment"):
        return [name + "=" * (kind == "assignment") for name in parameter_names()]
    if kind == "setting":
        return [f"{name}=" for name in settings.KNOWN]
    ports = serial_ports()
    if kind == "port":
        return ["auto", *(port.device for port in ports)]
    there = [port.name for port in ports] + [name for board in served_boards() for name in board.names]
    there += [bus.name for bus in network_interfaces()]
    return there if kind == "bus" else ["auto", "native", "qemu", "virtual", *there]
