"""Settings that plumb remembers for its user: settings.toml in the platform's folder for them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from plumb.errors import UsageError
from plumb.files import places, toml_text
from plumb.files.input_files import read_bytes
from plumb.files.whole_files import write_whole
from plumb.near_names import did_you_mean

KNOWN = {
    "board": "the board of a command whose --board is left out: a name, or auto",
    "port": "the serial adapter of `plumb flash` and `plumb setup` when --port is left out: a port, or auto",
    "can": "a CAN bus that --board auto may ask for a board: can:INTERFACE:CHANNEL[@KBIT]",
}
"""Name -> meaning."""
MOST_BYTES = 1 << 16
_HEAD = "# Settings of plumb: `plumb settings` lists them, `plumb settings NAME=VALUE` changes them.\n"


def settings_file() -> Path:
    return places.config_folder() / "settings.toml"


def read() -> dict[str, str]:
    """The settings by name; {} where none were ever written. Raises UsageError for a file that cannot be used."""
    path = settings_file()
    if not path.exists():
        return {}
    remedy = f"correct {path}, or delete it"
    try:
        said = toml_text.parse(read_bytes(path, MOST_BYTES, remedy).decode())
    except ValueError as error:
        raise UsageError(f"{path} cannot be read ({str(error).splitlines()[0]}): {remedy}") from None
    for name, value in said.items():
        require_known(name)
        if not isinstance(value, str) or not value:
            raise UsageError(f"{path}: {name} is no text in quotes: {remedy}")
    return said


def require_known(name: str) -> None:
    """Raises UsageError for a name that is no setting."""
    if name not in KNOWN:
        raise UsageError(f"there is no setting '{name}'{did_you_mean(name, KNOWN)}; use one of {', '.join(KNOWN)}")


def change(wanted: Mapping[str, str | None]) -> dict[str, str]:
    """Set these, or forget those that are None; returns all settings. Raises UsageError, and then nothing changed."""
    for name in wanted:
        require_known(name)
    after = {name: value for name, value in {**read(), **wanted}.items() if value is not None}
    lines = [f"{name} = {json.dumps(value)}\n" for name, value in sorted(after.items())]
    write_whole({settings_file(): _HEAD + "".join(lines)}, "make its folder writable, or move it with XDG_CONFIG_HOME")
    return after
