"""`plumb tune noise` for a reader: tables, Allan plots, JSON."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from plumb.analyses.identification import chosen_settings
from plumb.analyses.identification.noise import ChannelNoise, FilterNoise
from plumb.analyses.identification.noise_fit import Estimate
from plumb.analyses.identification.rest import Rest
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, Line, Plot, Table
from plumb.proof.xy_plot import Axis, Curve, XyPlot

COLOURS = (ESTIMATE, SECOND, SENSOR, "#1a8f7a", "#8a63d2", "#c2578f")
SHOWN = {"g": (1e3, "mg")}
"""Unit of a signal -> factor and unit in which its noise is printed."""
KINDS = {True: "Gyro", False: "Accelerometer"}
MEASURE = (
    "Figures of IEEE Std 952 with their 95 % intervals, fitted together by maximum likelihood. <: the recording is too "
    "short to distinguish it from none; the figure is the most that it can be."
)
CURVES = (
    "Dots: overlapping Allan deviation with its 95 % interval. Lines: the fitted noises together. White noise falls "
    "with a slope of -1/2, bias instability is level, a random walk rises with +1/2."
)


def unit_of(one: ChannelNoise) -> tuple[float, str]:
    return SHOWN.get(one.channel.unit, (1.0, one.channel.unit))


def _cell(estimate: Estimate, factor: float) -> str:
    shown = estimate.scaled(factor)
    if shown.low == 0.0:
        return f"< {shown.high:.3g}"
    return f"{shown.value:.3g} ({shown.low:.3g} to {shown.high:.3g})"


def noise_tables(found: Sequence[ChannelNoise]) -> list[Table]:
    """A table for the gyros, one for the accelerometers."""
    tables: list[Table] = []
    for rate, title in KINDS.items():
        own = [one for one in found if one.channel.rate is rate]
        if not own:
            continue
        factor, unit = unit_of(own[0])
        rows = [
            [
                one.channel.name,
                *(_cell(part, factor) for part in (one.model.white, one.model.flicker, one.model.walk)),
                f"{factor * one.rms:.3g}",
            ]
            for one in own
        ]
        head = [
            "signal",
            f"white noise ({unit}/sqrt(Hz))",
            f"bias instability ({unit})",
            f"random walk ({unit}/sqrt(s))",
            f"rms of a sample ({unit})",
        ]
        tables.append(Table(title, head, rows, MEASURE if not tables else ""))
    return tables


def settings_tables(noise: FilterNoise) -> list[Table]:
    """The settings, and, if the board can hold them, the lines that set them."""
    rows = [[name, f"{value:.5g}", noise.notes[name.rpartition(".")[2]]] for name, value in noise.values.items()]
    note = "The least that the filter needs. Motion that its model leaves out needs more: `plumb tune filter` finds it."
    title = f"Q and R of {noise.system}, tuning {noise.tuning_name}"
    head = ["setting", "value", "from"]
    if noise.refusal:
        return [Table(title, head, rows, f"The board cannot hold these: {noise.refusal}.")]
    lines = [[line] for line in chosen_settings.apply_lines(noise.values)]
    return [Table(title, head, rows, note), Table("To use them", [""], lines, chosen_settings.BOARDS)]


def plots(rest: Rest, found: Sequence[ChannelNoise]) -> list[XyPlot | Plot]:
    """Allan plots of gyros and accelerometers, then the signals."""
    drawn: list[XyPlot | Plot] = []
    for rate, title in KINDS.items():
        own = [one for one in found if one.channel.rate is rate]
        if own:
            drawn.append(_allan_plot(title, own))
    for rate, title in KINDS.items():
        own = [one for one in found if one.channel.rate is rate]
        if own:
            drawn.append(_signals(title, own, rest))
    return drawn


def _allan_plot(title: str, own: Sequence[ChannelNoise]) -> XyPlot:
    factor, unit = unit_of(own[0])
    curves = []
    for at, one in enumerate(own):
        colour, allan = COLOURS[at % len(COLOURS)], one.allan
        low, high = factor * allan.low, factor * allan.high
        curves.append(
            Curve(one.channel.name, allan.tau_s, factor * allan.deviation, colour, low=low, high=high, points=True)
        )
        fitted = factor * np.sqrt(one.model.allan_variance(allan.tau_s))
        curves.append(Curve(f"{one.channel.name}, fitted", allan.tau_s, fitted, colour))
    x, y = Axis("averaging time (s)", log=True), Axis(f"Allan deviation ({unit})", log=True)
    return XyPlot(f"{title}: Allan deviation", x, y, curves, CURVES)


def _signals(title: str, own: Sequence[ChannelNoise], rest: Rest) -> Plot:
    """The signals without their means, which differ by far more than their noise."""
    factor, unit = unit_of(own[0])
    time_s = rest.first_s + rest.period_s * np.arange(len(own[0].channel.values))
    lines = [
        Line(one.channel.name, factor * (one.channel.values - np.mean(one.channel.values)), COLOURS[at % len(COLOURS)])
        for at, one in enumerate(own)
    ]
    return Plot(f"{title} at rest, less its mean", unit, time_s, lines)


def heading(rest: Rest) -> str:
    """One sentence about the data that were used."""
    samples = len(rest.channels[0].values)
    part = f"at rest from {rest.first_s:.1f} to {rest.last_s:.1f} s of {rest.whole_s:.1f} s"
    return f"{rest.path.name}: {part}, {samples} samples every {1e3 * rest.period_s:.4g} ms."


def to_json(rest: Rest, found: Sequence[ChannelNoise], noise: FilterNoise) -> dict[str, object]:
    def estimate(one: Estimate) -> dict[str, float]:
        return {"value": one.value, "low": one.low, "high": one.high}

    signals = [
        {
            "name": one.channel.name,
            "unit": one.channel.unit,
            "rms": one.rms,
            "white_per_rthz": estimate(one.model.white),
            "bias_instability": estimate(one.model.flicker),
            "random_walk_per_rts": estimate(one.model.walk),
            "warnings": one.warnings(),
        }
        for one in found
    ]
    return {
        "recording": str(rest.path),
        "first_s": rest.first_s,
        "last_s": rest.last_s,
        "period_s": rest.period_s,
        "samples": len(rest.channels[0].values),
        "signals": signals,
        "system": noise.system,
        "tuning": noise.tuning_name,
        "period_us": noise.tuning.period_us,
        "settings": noise.values,
        "refusal": noise.refusal,
        "apply": [] if noise.refusal else chosen_settings.apply_lines(noise.values),
    }
