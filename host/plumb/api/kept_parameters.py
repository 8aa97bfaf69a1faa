"""`board.params.kept`: what this computer keeps of one board's parameters, changes that can be undone and profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from plumb.errors import UsageError
from plumb.link import parameter_history, parameter_profiles
from plumb.link.parameter_history import Change
from plumb.spec import parameter_file
from plumb.systems import shipped_tunings
from plumb.systems.shipped_tunings import Origin


class KeptParameters:
    """Changes and profiles of the board with this unique id; `plumb params` keeps them.

    Attributes:
        unique_id: Of the board.
    """

    def __init__(self, unique_id: str) -> None:
        self.unique_id = unique_id

    # ---- changes ----

    @property
    def changes(self) -> list[Change]:
        """The changes that were made from here, the latest last. Raises UsageError for a damaged file."""
        return parameter_history.read(self.unique_id)

    def add(self, did: str, before: Mapping[str, int], after: Mapping[str, int], tuning: str | None = None) -> None:
        """Remember a change, if it is one.

        Args:
            did: The command that made it.
            before: The whole table by name, as it was.
            after: The table as it is now.
            tuning: The shipped tuning that the parameters come from since then; "": not known, None: as before.

        Raises:
            UsageError: The change cannot be kept.
        """
        if after != before:
            parameter_history.add(self.unique_id, parameter_history.change_of(did, before, after, tuning))

    def before_last(self, table: Mapping[str, int]) -> dict[str, int]:
        """The table as it was before the change that left `table`. Raises UsageError if none from here did."""
        changes = self.changes
        return {**table, **changes[parameter_history.last_undoable(changes, table)].before}

    def forget_last(self, table: Mapping[str, int]) -> None:
        """Forget the change that left `table`, and those after it: it was taken back. Raises UsageError."""
        changes = self.changes
        parameter_history.write(self.unique_id, changes[: parameter_history.last_undoable(changes, table)])

    def origin(self, table: Mapping[str, int]) -> Origin:
        """The shipped tuning that a table came from: as the changes from here say, else the nearest."""
        try:
            recorded = parameter_history.tuning_of(self.changes)
        except UsageError:  # taking a change back reports a damaged file of changes
            recorded = None
        return shipped_tunings.origin_of(table, recorded)

    # ---- profiles ----

    @property
    def profiles(self) -> list[str]:
        """Names of the board's profiles."""
        return parameter_profiles.names(self.unique_id)

    def profile(self, name: str) -> Path:
        """The file of a profile. Raises UsageError with those there are."""
        return parameter_profiles.existing(self.unique_id, name)

    def holds(self, name: str, table: Mapping[str, int]) -> bool:
        """Whether a profile is this whole table; a damaged one is none."""
        try:
            return parameter_file.read(self.profile(name)).values == table
        except UsageError:
            return False

    def save_profile(self, name: str, words: Sequence[int], *, replace: bool = False) -> Path:
        """Write a whole table as a profile; its file. Raises UsageError if it exists and is not to be replaced."""
        return parameter_profiles.save(self.unique_id, name, words, replace=replace)

    def delete_profile(self, name: str) -> Path:
        """Remove a profile; the file it had. Raises UsageError."""
        return parameter_profiles.delete(self.unique_id, name)
