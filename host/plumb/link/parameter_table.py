"""Read the whole parameter table of a board, or stage and commit another."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.errors import LinkError
from plumb.link.session import Session
from plumb.spec import parameters


def read_table(session: Session) -> list[int]:
    """Every parameter in use, checked against the CRC-32 in the board's identity. Raises LinkError on a mismatch."""
    identity = session.connect()
    words = session.read_parameters()
    if parameters.crc32(words) != identity["PARAMETER_CRC"]:
        raise LinkError("the parameters that came back are not those of the board's CRC-32: check the cable, try again")
    return words


def commit(session: Session, values: Mapping[str, int]) -> int:
    """Stage and commit the whole table; ends a run in progress that the board does not let it change. Returns the
    CRC-32; raises as Session.upload."""
    rows = parameters.table()
    control = [values[row.name] for row in rows if row.owner == "control"]
    return session.upload(control, **{row.name: values[row.name] for row in rows if row.owner == "link"})
