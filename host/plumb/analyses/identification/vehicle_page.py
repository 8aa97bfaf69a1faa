"""`plumb tune vehicle` for a reader: tables and JSON."""

from __future__ import annotations

from collections.abc import Mapping

from plumb.analyses.identification import chosen_settings
from plumb.analyses.identification.vehicle_fit import WINDOW_S, Estimate, VehicleFit
from plumb.proof.report import Table

NOTE = (
    "Intervals of 95 % for flights like this one. The drag is that of rotors and frame together at its speeds: it is "
    "the value to set in an estimator."
)
UNSEEN = "Offsets of the accelerometer are not reported: without turns of the heading they look like wind."


def tables(fit: VehicleFit, settings: Mapping[str, float]) -> list[Table]:
    """The results, and the lines that set them."""
    rows = [_row("thrust command of a hover", fit.hover), _row("drag by mass and speed, 1/s", fit.drag_per_s)]
    for axis, offset in zip("xy", fit.offset_g or (), strict=False):
        rows.append(_row(f"offset of the accelerometer along {axis}, g", offset))
    note = NOTE if fit.offset_g else f"{NOTE} {UNSEEN}"
    lines = [[line] for line in chosen_settings.apply_lines(settings)]
    found = Table("Vehicle", ["", "found", "95 %"], rows, note)
    return [found, Table("To use them", [""], lines, chosen_settings.BOARDS)]


def _row(label: str, found: Estimate) -> list[str]:
    return [label, f"{found.value:.4g}", f"{found.value - found.half:.4g} to {found.value + found.half:.4g}"]


def lead(name: str, system: str, fit: VehicleFit) -> str:
    """One sentence about the data that were used."""
    moved = f"the speed changed by {fit.speed_mps:.1f} m/s rms"
    return f"{system} in {name}: {fit.windows} windows of {WINDOW_S:g} s in the air, in which {moved}."


def to_json(system: str, fit: VehicleFit, settings: Mapping[str, float]) -> dict[str, object]:
    def estimate(one: Estimate) -> dict[str, float]:
        return {"value": one.value, "low": one.value - one.half, "high": one.value + one.half}

    return {
        "system": system,
        "windows": fit.windows,
        "speed_mps": fit.speed_mps,
        "hover": estimate(fit.hover),
        "drag_per_s": estimate(fit.drag_per_s),
        "offset_g": None if fit.offset_g is None else [estimate(one) for one in fit.offset_g],
        "settings": dict(settings),
        "apply": chosen_settings.apply_lines(settings),
    }
