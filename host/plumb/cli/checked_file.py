"""A recording, audited before a command uses it: its faults come first, and --as-found undoes what is sure."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from plumb.cli import options

if TYPE_CHECKING:
    from plumb.audit.audit import Audit
    from plumb.readers.recording import Recording
    from plumb.readers.replay import ReplayRequest


def add_as_found(parser: argparse.ArgumentParser, given: bool = True) -> None:
    """--as-found; given: --units, --columns, --frame, too."""
    parser.add_argument(
        "--as-found", action="store_true", help="of units: undo what `plumb check` is sure of, and print what that was"
    )
    if given:
        options.add_given(parser)


def load(path: Path, arguments: argparse.Namespace) -> tuple[Recording, Audit]:
    """The recording, with what is sure undone by --as-found; its faults go to stderr. Raises UsageError for a file that
    cannot be used."""
    from plumb.audit.audited_files import audited, recording_of
    from plumb.errors import UsageError

    as_found = arguments.as_found
    found = audited(path, given=options.given_of(arguments))
    try:
        loaded = recording_of(path, found, as_found)
    except UsageError as error:
        if as_found or not found.sure_mends:
            raise
        raise error.saying(f"{error}; --as-found undoes {' '.join(found.sure_mends)}") from None
    _say_faults(path, found)
    for sentence in loaded.notes:
        print(f"plumb: warning: {path.name}: {sentence}", file=sys.stderr)
    _say_mends(path, found, as_found)
    return loaded, found


def request(arguments: argparse.Namespace, loaded: Recording | None) -> ReplayRequest:
    """What a system is to get of the file: --axis, --period-us, --seconds, --decimate. loaded: None for a file that the
    system reads itself."""
    from plumb.readers.replay import ReplayRequest

    axis, decimate = arguments.axis or "x", arguments.decimate or 1
    return ReplayRequest(arguments.file, axis, arguments.period_us, arguments.seconds, decimate, loaded=loaded)


def said_first(paths: Iterable[Path], as_found: bool) -> dict[str, dict[str, object]]:
    """For JSON: what was found in each file, by its name, and what is undone; both go to stderr. A file that cannot be
    read is left out: whoever uses it says so."""
    from plumb.audit.audited_files import audited
    from plumb.errors import UsageError

    found = {}
    for path in dict.fromkeys(paths):
        with contextlib.suppress(UsageError):
            one = audited(path)
            _say_faults(path, one)
            _say_mends(path, one, as_found)
            found[path.name] = told(one, as_found)
    return found


def _say_faults(path: Path, found: Audit) -> None:
    for one in found.faults:
        print(f"plumb: warning: {path.name}: {one.line}", file=sys.stderr)


def _say_mends(path: Path, found: Audit, as_found: bool) -> None:
    if as_found:
        print(f"{path.name} as found: {' '.join(found.sure_mends) or 'nothing to undo'}", file=sys.stderr)
    elif found.sure_mends:
        print(f"plumb: warning: {path.name}: --as-found undoes {' '.join(found.sure_mends)}", file=sys.stderr)


def told(found: Audit, as_found: bool) -> dict[str, object]:
    """For JSON: what was found, and what of it is undone."""
    return {"findings": [one.to_json() for one in found.findings], "undone": found.sure_mends if as_found else []}
