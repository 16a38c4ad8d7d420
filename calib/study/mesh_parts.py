"""What is known of the difference of two meshes beside itself: the pin's part, and derivatives."""

from __future__ import annotations

from dataclasses import dataclass

from fe.response import Array


@dataclass(frozen=True)
class PinError:
    """What of the difference from the finer mesh's runs is the pin's, which gives way less there.

    Measured on the sampling mesh: the pin's part may be as large as the mesh's, of the other sign,
    and is followed far better, so that a share of their sum would tell of neither. Forces follow
    the penetration, which `stiffening` k divides at every pressure: of c they miss c / k, which is
    c / (k - 1) of the difference. That is corrected for, too, up to a rigid pin.
    """

    stiffening: float
    """how many times less the pin of the finer mesh's runs gives way"""
    signed_force: Array
    """(n_check, n_step) force under the pin of the emulator's runs over that under the other - 1"""
    field: Array
    """(n_check, n_step, n_point, 3) displacement under the one minus that under the other, mm"""

    @property
    def beyond(self) -> float:
        """How far a rigid pin is beyond the finer mesh's, as a share of the difference."""
        return 1.0 / (self.stiffening - 1.0)


@dataclass(frozen=True)
class MeshSlopes:
    """Derivatives of the field's difference between two meshes by the ratios, at each check."""

    field: Array
    """(n_check, n_step, n_point, 3, d) of coarse minus fine displacement under a rigid pin, mm"""
    reach: Array
    """(d,) how far from a check they are followed"""


@dataclass(frozen=True)
class AtCheck:
    """The FE model itself at the last check, corrected to the finer mesh and a rigid pin."""

    tangents: Array
    """(d, n_step, n_point, 3) derivatives of its field by the ratios, mm per unit"""
    field: Array
    """(n_step, n_point, 3) mm"""
