"""`plumb tune filter` for a reader: settings and consistency before and after, plots, JSON."""

from __future__ import annotations

import numpy as np

from plumb.analyses.identification import chosen_settings
from plumb.analyses.identification.filter_inputs import FilterInputs
from plumb.analyses.identification.innovations import LAGS, Innovations
from plumb.analyses.identification.likelihood import NAMES, FilterFit
from plumb.proof.metrics import angle_rmse_deg
from plumb.proof.report import ESTIMATE, SECOND, SENSOR, TRUTH, Line, Plot, Table
from plumb.proof.xy_plot import Axis, Curve, XyPlot
from plumb.spec.tuning import AxisTuning

WHITE_CHANCE = 0.01
"""Below this chance the innovations after the fit count as correlated: the model leaves something out."""
CORRELATED = (
    "the innovations are still correlated: the recording has motion or vibration that the filter's model leaves out, "
    "and no Q and R describe it; judge the settings by the tilt error"
)
QUANTILES = 199
CONSISTENCY = (
    "NIS: innovation squared over the variance that the filter states. Where Q and R describe the recording its mean "
    "is 1, 95 % of it is below 3.84, and the innovations are white: no correlation between steps."
)


def whole_names(inputs: FilterInputs) -> dict[str, str]:
    """Last name of a setting -> its whole name in the tuning."""
    return {name.rpartition(".")[2]: name for name in chosen_settings.named(inputs.tuning, dict.fromkeys(NAMES, 0.0))}


def settings_of(inputs: FilterInputs, fit: FilterFit) -> dict[str, float]:
    """The settings that the fit found, by whole name, as a person types them."""
    return chosen_settings.named(inputs.tuning, {name: getattr(fit.variances, name) for name in fit.figures})


def tuned(inputs: FilterInputs, fit: FilterFit) -> AxisTuning:
    """The tuning with them. R's largest value is not less than R."""
    changed = chosen_settings.changed(inputs.tuning, settings_of(inputs, fit))
    trust = changed.trust
    if trust.r_max_deg2 < trust.r_deg2 or not trust.gain_deg2:
        changed = chosen_settings.changed(changed, {"trust.r_max_deg2": trust.r_deg2})
    return changed


def tilt_rmse_deg(inputs: FilterInputs, one: Innovations) -> float | None:
    """Error against the recording's reference; None without one."""
    if not inputs.scored.any():
        return None
    return float(angle_rmse_deg(one.tilt_deg, inputs.truth_deg, inputs.scored))


def tables(inputs: FilterInputs, fit: FilterFit) -> list[Table]:
    whole = whole_names(inputs)
    rows = []
    for name in NAMES:
        before = f"{getattr(inputs.start, name):.5g}"
        if name in fit.kept:
            rows.append([whole[name], before, before, "the recording does not determine it: kept"])
            continue
        figure = fit.figures[name]
        interval = f"{figure.low:.3g} to {figure.high:.3g}" if np.isfinite(figure.high) else "flat: not known"
        rows.append([whole[name], before, f"{figure.value:.5g}", interval])
    found = [Table("Settings", ["setting", "before", "after", "95 %"], rows), _consistency(inputs, fit)]
    if not useful(inputs, fit):
        return found
    lines = [[line] for line in chosen_settings.apply_lines(settings_of(inputs, fit))]
    return [*found, Table("To use them", [""], lines, chosen_settings.BOARDS)]


def _consistency(inputs: FilterInputs, fit: FilterFit) -> Table:
    pairs = (fit.before, fit.after)
    rows = [
        ["mean NIS", *(f"{one.mean_nis:.3f}" for one in pairs), "1"],
        ["innovations inside 95 %", *(f"{100.0 * one.inside:.1f} %" for one in pairs), "95 %"],
        ["correlation of neighbours", *(f"{one.autocorrelation[0]:+z.3f}" for one in pairs), "0"],
        [f"chance of being white ({LAGS} lags)", *(f"{one.whiteness:.2g}" for one in pairs), f"over {WHITE_CHANCE:g}"],
        ["innovation, rms (deg)", *(f"{np.std(one.innovation_deg):.4g}" for one in pairs), ""],
    ]
    errors = [tilt_rmse_deg(inputs, one) for one in pairs]
    if errors[0] is not None:
        rows.append(["tilt error against the reference, rms (deg)", *(f"{error:.3f}" for error in errors), "0"])
    gain = f"The logarithm of the likelihood gains {fit.gain:.4g}."
    return Table("Consistency of the filter", ["", "before", "after", "ideal"], rows, f"{CONSISTENCY} {gain}")


def useful(inputs: FilterInputs, fit: FilterFit) -> bool:
    """Whether the board can hold the settings, and the tilt error, where it is known, does not grow."""
    return not _grows(inputs, fit) and not chosen_settings.refusal(tuned(inputs, fit))


def _grows(inputs: FilterInputs, fit: FilterFit) -> str:
    """A sentence if the tilt error grows."""
    before, after = tilt_rmse_deg(inputs, fit.before), tilt_rmse_deg(inputs, fit.after)
    if before is None or after is None or after <= before:
        return ""
    return (
        f"the tilt error against the reference grows from {before:.3f} to {after:.3f} deg rms: the accelerometer errs "
        "in ways that are no white noise, and the tuning before suits the motion better"
    )


def warnings(inputs: FilterInputs, fit: FilterFit) -> list[str]:
    """Warnings to read before the settings are used."""
    correlated = fit.after.whiteness < WHITE_CHANCE
    refusal = chosen_settings.refusal(tuned(inputs, fit))
    return [
        *([CORRELATED] if correlated else []),
        *([f"the board cannot hold the settings: {refusal}"] if refusal else []),
        *filter(None, [_grows(inputs, fit)]),
    ]


def plots(inputs: FilterInputs, fit: FilterFit) -> list[XyPlot | Plot]:
    pairs = (("before", fit.before, SENSOR), ("after", fit.after, ESTIMATE))
    lags = np.arange(1.0, LAGS + 1.0)
    bound = fit.after.white_within
    curves = [Curve(f"{name}", lags, one.autocorrelation, colour, points=True) for name, one, colour in pairs]
    curves += [
        Curve("95 % of white innovations", lags, np.full(LAGS, sign * bound), TRUTH, 1.0, dashed=True)
        for sign in (1.0, -1.0)
    ]
    correlation = XyPlot("Whiteness", Axis("lag (steps)"), Axis("autocorrelation of the innovations"), curves)
    return [correlation, _quantiles(fit), *(_over_time(inputs, name, one) for name, one, _ in pairs)]


def _quantiles(fit: FilterFit) -> XyPlot:
    """Quantiles of the normalised innovations over those of the normal distribution."""
    from scipy.stats import norm

    share = np.arange(1, QUANTILES + 1) / (QUANTILES + 1)
    normal = np.asarray(norm.ppf(share))
    curves = [Curve("normal, variance as stated", normal, normal, TRUTH, 1.0, dashed=True)]
    for name, one, colour in (("before", fit.before, SENSOR), ("after", fit.after, ESTIMATE)):
        curves.append(Curve(name, normal, np.quantile(one.normalised, share), colour, points=True))
    x, y = Axis("quantile of the normal distribution"), Axis("innovation / its stated deviation")
    note = "Points on the dashed line: the innovations are as the filter expects. Steeper ends: outliers."
    return XyPlot("Distribution of the innovations", x, y, curves, note)


def _over_time(inputs: FilterInputs, name: str, one: Innovations) -> Plot:
    measured = inputs.measured
    time_s = measured.period_s * np.arange(measured.settled, len(measured.z_deg))
    lines = [
        Line("stated: 0 ± 2 sigma", np.zeros(len(time_s)), ESTIMATE, 0.8, 2.0 * np.sqrt(one.s_deg2)),
        Line("innovation", one.innovation_deg, SECOND, 0.8),
    ]
    return Plot(f"Innovations {name}", "deg", time_s, lines)


def to_json(inputs: FilterInputs, fit: FilterFit) -> dict[str, object]:
    def consistency(one: Innovations) -> dict[str, object]:
        return {
            "mean_nis": one.mean_nis,
            "inside_95": one.inside,
            "autocorrelation_1": float(one.autocorrelation[0]),
            "white_chance": one.whiteness,
            "log_likelihood": -one.loss,
            "tilt_rmse_deg": tilt_rmse_deg(inputs, one),
        }

    whole = whole_names(inputs)
    intervals = {whole[name]: [figure.low, figure.high] for name, figure in fit.figures.items()}
    return {
        "recording": inputs.title,
        "system": inputs.tuning.system,
        "tuning": inputs.tuning_name,
        "period_us": inputs.tuning.period_us,
        "steps": len(inputs.measured.z_deg),
        "settings_before": {whole[name]: getattr(inputs.start, name) for name in NAMES},
        "settings": settings_of(inputs, fit),
        "intervals_95": {name: ends if np.isfinite(ends[1]) else None for name, ends in intervals.items()},
        "kept": [whole[name] for name in fit.kept],
        "before": consistency(fit.before),
        "after": consistency(fit.after),
        "refusal": chosen_settings.refusal(tuned(inputs, fit)),
        "warnings": warnings(inputs, fit),
        "apply": chosen_settings.apply_lines(settings_of(inputs, fit)) if useful(inputs, fit) else [],
    }
