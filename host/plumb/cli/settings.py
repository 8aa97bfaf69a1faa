"""Show or change what plumb remembers for you.

    plumb settings
    plumb settings board=auto                        every command that needs a board takes the only one that is here
    plumb settings board=serial:/dev/ttyUSB0 port=/dev/ttyUSB0
    plumb settings can=can:socketcan:can0            --board auto asks this bus, too
    plumb settings --forget board

The settings are a file in the platform's place for them (Linux: ~/.config/plumb/settings.toml). An option on the
command line goes before a setting, and a command says on stderr which board it took from here.
"""

from __future__ import annotations

import argparse
import json

from plumb.cli import options


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from plumb.files.settings import KNOWN

    parser.add_argument("assignments", nargs="*", metavar="NAME=VALUE", help="remember this")
    parser.add_argument("--forget", action="append", choices=tuple(KNOWN), help="forget this one; repeatable")
    options.add_json(parser)


def main(arguments: argparse.Namespace) -> int:
    from plumb.errors import UsageError
    from plumb.files import settings

    wanted: dict[str, str | None] = dict.fromkeys(arguments.forget or ())
    for text in arguments.assignments:
        name, equals, value = text.partition("=")
        if not equals or not value:
            spaces = ", without spaces" if "=" in arguments.assignments else ""
            raise UsageError(f"'{text}' sets nothing: write NAME=VALUE{spaces}, or --forget NAME")
        require_valid(name, value)
        wanted[name] = value
    after = settings.change(wanted) if wanted else settings.read()
    if arguments.json:
        print(json.dumps({"file": str(settings.settings_file()), "settings": after}))
        return 0
    for name, about in settings.KNOWN.items():
        print(f"{name} = {after[name]}" if name in after else f"{name} is not set", f"({about})")
    print(f"file: {settings.settings_file()}")
    return 0


def require_valid(name: str, value: str) -> None:
    """Raises UsageError for a value that the setting cannot have."""
    from plumb.errors import UsageError
    from plumb.files.settings import require_known
    from plumb.link.discovery import AUTO
    from plumb.link.endpoint_names import CanName, parse_board, quoted
    from plumb.link.transports.serial_ports import check_port

    require_known(name)
    if value == AUTO and name != "can":
        return
    if value == AUTO:
        raise UsageError("'auto' is no CAN bus: write can:INTERFACE:CHANNEL[@KBIT]")
    if name == "port":
        check_port(value)
    elif not isinstance(parse_board(value), CanName) and name == "can":
        raise UsageError(f"{quoted(value)} is no CAN bus: write can:INTERFACE:CHANNEL[@KBIT]")
