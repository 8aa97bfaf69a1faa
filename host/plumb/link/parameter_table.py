"""Read the whole parameter table of a board, or stage and commit another."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.errors import LinkError, UsageError
from plumb.link import armed_changes
from plumb.link.identity import NackError
from plumb.link.session import Session
from plumb.spec import parameters
from plumb.spec.parameter_file import by_name


def read_table(session: Session) -> list[int]:
    """Every parameter in use, checked against the CRC-32 in the board's identity. Raises LinkError on a mismatch."""
    identity = session.connect()
    words = session.read_parameters()
    if parameters.crc32(words) != identity["PARAMETER_CRC"]:
        raise LinkError("the parameters that came back are not those of the board's CRC-32: check the cable, try again")
    return words


def commit(session: Session, values: Mapping[str, int], before: Mapping[str, int] | None = None) -> int:
    """Stage and commit a table. Returns the CRC-32. before: the table in use, as it was just read; None: read it here.

    A run in real time goes on if only gains of controllers change. An armed one is never ended: raises UsageError when
    the board refuses the change because it is armed, with the value that it takes instead. Any other run ends. Raises
    as Session.upload, too.
    """
    rows = parameters.table()
    table = by_name(read_table(session)) if before is None else before
    control = [values[row.name] for row in rows if row.owner == "control"]
    words = parameters.whole_table(control, **{row.name: values[row.name] for row in rows if row.owner == "link"})
    try:
        return session.parameters.change([table[row.name] for row in rows], words)
    except NackError as error:
        if error.reason == "ARMED":
            armed_with = session.parameters.at_arming
            first = None if armed_with is None else by_name(armed_with)
            raise UsageError(armed_changes.refusal(table, values, error.detail, session.pump, first)) from None
        if error.reason == "OWNER":
            raise LinkError(
                "the board is armed over its other link or by its arm switch: only from there its gains change"
            ) from None
        raise
