"""Published algorithms as their authors or others ship them on PyPI, with the defaults that they document.

    VQF, BasicVQF   vqf (D. Laidig, T. Seel, "VQF: Highly accurate IMU orientation estimation with bias estimation and
                    magnetic disturbance rejection", Information Fusion 91, 2023), the 6D estimate
    Madgwick        AHRS, gain 0.033 (S. Madgwick, "An efficient orientation filter for inertial and inertial/magnetic
                    sensor arrays", report x-io, 2010)
    Mahony          AHRS, k_P 1, k_I 0.3 (R. Mahony, T. Hamel, J.-M. Pflimlin, "Nonlinear complementary filters on the
                    special orthogonal group", IEEE TAC 53(5), 2008)

Costs are quoted where a publication has them; none of these is compiled with the flags of the firmware.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from types import ModuleType

import numpy as np
import numpy.typing as npt

from plumb.analyses.comparison.samples import Samples
from plumb.errors import UsageError
from plumb.extras import install_hint

FloatArray = npt.NDArray[np.float64]
Attitudes = Callable[[ModuleType, Samples], object]
"""Attitudes of all samples, w, x, y, z from sensor to earth, (N, 4); the packages carry no types."""


@dataclass(frozen=True)
class Published:
    """An algorithm of a package. module: what is imported; package: its name on PyPI; settings: what it runs with;
    cost: as published, with its source. bias_limit_dps: from its module the largest bias of an axis that it learns, 0
    where it learns none, None where it sets no limit."""

    name: str
    module: str
    package: str
    settings: str
    cost: str
    attitudes: Attitudes
    bias_limit_dps: Callable[[ModuleType], float | None]

    @property
    def origin(self) -> str:
        """Package and version that is installed."""
        return f"{self.package} {metadata.version(self.package)}"

    def run(self, samples: Samples) -> FloatArray:
        """Attitudes w, x, y, z, (N, 4). Raises UsageError where the package is not installed."""
        return np.asarray(self.attitudes(imported(self), samples), np.float64)


def imported(one: Published) -> ModuleType:
    """Raises UsageError with what to install."""
    try:
        return importlib.import_module(one.module)
    except ImportError:
        raise UsageError(f"{one.package} is not installed; install it {install_hint('compare')}") from None


def _period_s(samples: Samples) -> float:
    return samples.period_us * 1e-6


def _vqf(module: ModuleType, samples: Samples) -> object:
    return module.VQF(_period_s(samples)).updateBatch(samples.gyr_radps, samples.acc_mps2)["quat6D"]


def _basic_vqf(module: ModuleType, samples: Samples) -> object:
    return module.BasicVQF(_period_s(samples)).updateBatch(samples.gyr_radps, samples.acc_mps2)["quat6D"]


def _madgwick(module: ModuleType, samples: Samples) -> object:
    return module.Madgwick(samples.gyr_radps, samples.acc_mps2, frequency=1.0 / _period_s(samples)).Q


def _mahony(module: ModuleType, samples: Samples) -> object:
    return module.Mahony(samples.gyr_radps, samples.acc_mps2, frequency=1.0 / _period_s(samples)).Q


def _vqf_bias_limit(module: ModuleType) -> float:
    return float(module.VQF(0.01).params["biasClip"])


def _no_bias(_module: ModuleType) -> float:
    return 0.0


def _no_limit(_module: ModuleType) -> None:
    return None


NOT_PUBLISHED = "not published"
PUBLISHED = (
    Published("VQF", "vqf", "vqf", "defaults, 6D", NOT_PUBLISHED, _vqf, _vqf_bias_limit),
    Published("BasicVQF", "vqf", "vqf", "defaults, 6D, no bias", NOT_PUBLISHED, _basic_vqf, _no_bias),
    Published("Madgwick", "ahrs.filters", "AHRS", "gain 0.033", NOT_PUBLISHED, _madgwick, _no_bias),
    Published("Mahony", "ahrs.filters", "AHRS", "k_P 1, k_I 0.3", NOT_PUBLISHED, _mahony, _no_limit),
)
