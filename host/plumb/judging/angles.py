"""The figures of a system that estimates an angle, or an attitude by its angle from the truth."""

from plumb.proof.measures import Measure

MAIN, APART = "angle_rmse_deg", "fixed_vs_reference_max_deg"
MEASURES = (
    Measure("accel_only_rmse_deg", "deg", "angle of the accelerometer alone against the truth, rms"),
    Measure(MAIN, "deg", "estimate against the truth, rms", suits=20.0),
    Measure("angle_max_deg", "deg", "estimate against the truth, largest"),
    Measure(APART, "deg", "integers against float64 on the same counts, largest"),
)
