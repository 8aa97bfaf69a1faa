"""Quantise the tuning of `quad`, and back."""

from __future__ import annotations

from plumb.contract.parameters import ControlParams
from plumb.systems.quad.tuning import QuadTuning
from plumb.tuning.groups import axis_of, axis_words, esc_of, esc_words
from plumb.tuning.variances import in_variances


def quantise(tuning: QuadTuning) -> ControlParams:
    """The integers; raises UsageError with the parameter, its value and the limit."""
    shared, lsb_deg2 = axis_words(tuning)
    return ControlParams.of("quad", {**shared, **esc_words(tuning.esc)}, in_variances(float(lsb_deg2)))


def dequantise(params: ControlParams) -> QuadTuning:
    """The tuning that the integers represent."""
    return QuadTuning(**axis_of(params), esc=esc_of(params))
