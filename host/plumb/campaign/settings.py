"""Settings of a tuning that a study varies, by their path in it: trust.r_deg2, kalman.rate."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from plumb import systems
from plumb.contract.scenario import tuning_for
from plumb.errors import UsageError
from plumb.proof import scenario_run
from plumb.spec.tuning import AnyTuning


def tuning_with(
    system: str, scenario: str | None, tuning: str | None, settings: Mapping[str, float | str]
) -> AnyTuning:
    """A tuning of a system with other numbers or names at these paths, for example trust.r_deg2 or kalman.rate. Raises
    UsageError for a path that it does not have."""
    known = systems.load(system)
    name = tuning or tuning_for(known, scenario or known.DEFAULT_SCENARIO)
    _, found = scenario_run.tuning_of(system, name)
    for path, value in settings.items():
        found = _replaced(found, path.split("."), value, f"tuning '{name}' of {system}")
    return found


def _replaced(
    settings: Any,  # Any: tunings are dataclasses of any kind
    path: list[str],
    value: float | str,
    of: str,
) -> Any:  # Any: of the same kind
    names = [one.name for one in dataclasses.fields(settings)] if dataclasses.is_dataclass(settings) else []
    if path[0] not in names:
        has = ", ".join(names) or "no part"
        raise UsageError(f"the {of} has no setting '{path[0]}'; it has {has}")
    now = getattr(settings, path[0])
    if len(path) > 1:
        return dataclasses.replace(settings, **{path[0]: _replaced(now, path[1:], value, f"{path[0]} of the {of}")})
    if isinstance(now, str) or isinstance(value, str):
        if type(now) is not type(value):
            wanted = "a name" if isinstance(now, str) else "no name"
            raise UsageError(f"{path[0]} of the {of} is {wanted}, not {value!r}")
        return dataclasses.replace(settings, **{path[0]: value})
    if not isinstance(now, int | float) or isinstance(now, bool):
        raise UsageError(f"{path[0]} of the {of} is no number")
    if isinstance(now, int) and value != int(value):
        raise UsageError(f"{path[0]} of the {of} is a whole number, not {value:g}")
    return dataclasses.replace(settings, **{path[0]: type(now)(value)})
