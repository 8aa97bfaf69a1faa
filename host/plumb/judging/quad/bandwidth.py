"""The quadrotor paper's rule for the accelerometer's low-pass: a bandwidth slightly above that of the motion.

Noise grows with the square root of the bandwidth. Less bandwidth delays the signal, and the error of a delayed tilt is
rate times delay. The filter has one pole: a resistor and a capacitor at each output of the accelerometer.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from plumb.errors import UsageError
from plumb.physics.sensors import ADC_COUNTS, ADC_NOISE_LSB, ADC_REFERENCE_V, Mma7260

SLIGHTLY_ABOVE = 1.25
"""Corner frequency divided by the motion's bandwidth. The paper says "slightly above" without a number; assumed."""
RESISTOR_OHM = 10_000.0
WIDEST_HZ = Mma7260().bandwidth_hz
"""Bandwidth of the sensor itself."""


@dataclass(frozen=True)
class Choice:
    """A low-pass for a motion. noise: behind it, rms; tilt_noise_deg and r_deg2 with the converter's noise, at level.

    delay_ms: of anything slow; gain and phase_deg: at the motion's edge.
    """

    motion_hz: float
    corner_hz: float
    resistor_ohm: float
    capacitor_nf: float
    noise_mg: float
    tilt_noise_deg: float
    r_deg2: float
    delay_ms: float
    gain: float
    phase_deg: float

    def to_json(self) -> dict[str, object]:
        return asdict(self)


def behind(corner_hz: float, motion_hz: float, resistor_ohm: float = RESISTOR_OHM) -> Choice:
    """Noise, delay and attenuation of a low-pass with this corner, for a motion up to motion_hz."""
    sensor = Mma7260(corner_hz)
    converter_lsb = math.hypot(ADC_NOISE_LSB, 1.0 / math.sqrt(12.0))
    converter_g = converter_lsb * ADC_REFERENCE_V / ADC_COUNTS / sensor.v_per_g
    tilt_noise_deg = math.degrees(math.hypot(sensor.noise_g, converter_g))
    tau_s, share = 1.0 / (2.0 * math.pi * corner_hz), motion_hz / corner_hz
    return Choice(
        motion_hz=motion_hz,
        corner_hz=corner_hz,
        resistor_ohm=resistor_ohm,
        capacitor_nf=1e9 * tau_s / resistor_ohm,
        noise_mg=1e3 * sensor.noise_g,
        tilt_noise_deg=tilt_noise_deg,
        r_deg2=tilt_noise_deg**2,
        delay_ms=1e3 * tau_s,
        gain=1.0 / math.hypot(1.0, share),
        phase_deg=math.degrees(math.atan(share)),
    )


def choose(motion_hz: float, resistor_ohm: float = RESISTOR_OHM) -> Choice:
    """The low-pass that the rule gives; raises UsageError for a motion or a resistor out of range."""
    if not 0.01 <= motion_hz <= WIDEST_HZ / SLIGHTLY_ABOVE:
        raise UsageError(
            f"a motion of {motion_hz:g} Hz: the accelerometer follows 0.01 to {WIDEST_HZ / SLIGHTLY_ABOVE:g} Hz"
        )
    if not 100.0 <= resistor_ohm <= 1e6:
        raise UsageError(f"a resistor of {resistor_ohm:g} ohm: take one between 100 ohm and 1 Mohm")
    return behind(SLIGHTLY_ABOVE * motion_hz, motion_hz, resistor_ohm)


def describe(choice: Choice) -> str:
    """The choice as text."""
    capacitor = choice.capacitor_nf
    farads = f"{capacitor:.3g} nF" if capacitor < 1000 else f"{capacitor / 1000:.3g} uF"
    return "\n".join(
        (
            f"motion up to {choice.motion_hz:g} Hz: low-pass at {choice.corner_hz:.3g} Hz ({SLIGHTLY_ABOVE:g} times)",
            f"  filter      {choice.resistor_ohm / 1e3:g} kohm and {farads} at each output",
            f"  noise       {choice.noise_mg:.2f} mg rms behind it: 350 ug * sqrt(pi/2 * corner)",
            f"  tilt noise  {choice.tilt_noise_deg:.3f} deg rms with the converter's: R = {choice.r_deg2:.3g} deg^2",
            f"  delay       {choice.delay_ms:.2f} ms; at {choice.motion_hz:g} Hz gain {choice.gain:.3f}, phase"
            f" {choice.phase_deg:.1f} deg",
        )
    )
