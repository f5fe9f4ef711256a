"""Whether hand-eye poses may be used, by which limits, and why not."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from plop.geometry.handeye.fit import HandEyeFit

NAMED_UNITS = {0.001: "millimetres", 0.01: "centimetres", 0.0254: "inches"}


@dataclass(frozen=True)
class HandEyeRule:
    """Criteria for accepting a hand-eye solution.

    In three correct solutions of real rigs the board spreads by 2.0 to 4.4 mm (0.4 to 0.7 % of its distance) and 0.1
    to 0.7 deg; in wrong interpretations of the same data by 79 to 344 mm and 18 to 33 deg. The error of cameras and
    robots grows with the distance, and so does the limit; the error of a wrong interpretation grows with the motion,
    so a second limit is relative to that.
    """

    max_spread_of_distance: float = 0.03
    """Largest spread of the board, relative to its mean distance from the camera: 4 times that of correct sets."""
    least_limit_mm: float = 8.0
    """Smallest limit: a lower one would reject close boards for the robot's error; twice that of correct sets [mm]."""
    max_spread_deg: float = 2.5
    """Largest spread of its orientation: four times that of correct sets [deg]."""
    max_of_motion: float = 1 / 3
    """Largest spread relative to the motion: wrong interpretations show half of it or more."""
    scale_tolerance: float = 0.01
    """A scale this close to 1 is accepted: 4 mm at 0.4 m, the spread of correct solutions; a real, correct set shows
    0.979 (0.962 to 0.997)."""
    max_uncertainty_mm: float = 15.0
    """Largest standard error of positions seen by the camera: twice it is the 30 mm within which `calibrate` can still
    register cameras to each other [mm]."""
    max_uncertainty_of_distance: float = 0.02
    """The same relative to the board's mean distance: large rigs see farther and less precisely."""
    doubtful_uncertainty_mm: float = 5.0
    """A larger one is reported [mm]."""
    longest_on_gripper_m: float = 0.3
    """Largest distance of the camera or board on the gripper from it, unless it is less than twice the distance of the
    other one from the base: otherwise both poses are inverted, which is equally consistent [m]."""
    clearly: float = 3.0
    """Another interpretation is reported when its spread is smaller than that of the given one by this factor, as are
    all whose spread exceeds the best by at most this factor."""


RULE = HandEyeRule()


class HandEyeFault(Enum):
    """Reason for rejecting a solution."""

    NONE = "none"
    INCONSISTENT = "inconsistent"
    SCALE = "scale"
    UNDETERMINED = "undetermined"
    ROLES = "roles"


@dataclass(frozen=True)
class Judgement:
    """Assessment of hand-eye poses."""

    fault: HandEyeFault
    fit: HandEyeFit
    """As given."""
    scaled: HandEyeFit
    """With the board's scale fitted."""
    limit_mm: float
    """Largest accepted spread of the board [mm]."""
    limit_deg: float
    """The same of its orientation [deg]."""
    limit_uncertainty_mm: float
    """Largest accepted standard error [mm]."""
    on_gripper_m: float
    """Distance between the gripper and what is mounted on it: the camera, or the board of a fixed camera [m]."""
    at_base_m: float
    """Distance from the base of the other one [m]."""
    likely: tuple[str, ...] = ()
    """Other interpretations that would make the set consistent, with camera and board at plausible positions."""
    unlikely: tuple[str, ...] = ()
    """The same, but with the board behind the camera, or the part on the gripper farther from it than the base."""
    turns: tuple[float, float] | None = None
    """Rotations of robot and board between the two poses where they differ most, when they differ [deg]."""

    @property
    def scale_is_off(self) -> bool:
        """Return whether the board's scale differs from 1 beyond its interval."""
        low, high = self.scaled.scale_interval
        return not low <= 1 <= high

    def why(self, square_mm: float | None = None) -> str:
        """Explain in one sentence why the solution is rejected; empty when it is accepted.

        Args:
            square_mm: Edge of a square as given, if the board was detected with it [mm].
        """
        if self.fault is HandEyeFault.SCALE:
            return self.scale_text(square_mm)
        if self.fault is HandEyeFault.UNDETERMINED:
            return (
                f"the motion is too small, or too close to one axis, for its noise ({_mm(self.fit.spread_mm)}, "
                f"{self.fit.spread_deg:.1f} deg): the camera's position is uncertain by "
                f"{_mm(self.fit.uncertainty_mm)} (limit {self.limit_uncertainty_mm:.0f}). Record "
                "more poses that rotate by 20 degrees or more about two axes"
            )
        if self.fault is HandEyeFault.NONE:
            return ""
        if self.fault is HandEyeFault.ROLES:
            return (
                f"what is mounted on the gripper would be {self.on_gripper_m:.2f} m away from it, what is fixed "
                f"{self.at_base_m:.2f} m from the robot's base{self._otherwise('this would be reversed')}"
            )
        moves = (
            f"the board, which is fixed, would move by {_mm(self.fit.spread_mm)} "
            f"and {self.fit.spread_deg:.1f} deg (limits {self.limit_mm:.1f} mm, {self.limit_deg:.1f} deg)"
        )
        if self.likely or self.unlikely:
            return f"{moves}{self._otherwise('it would stay where it is')}"
        if self.turns is not None:
            return (
                f"{moves}; between two poses the robot rotates by {self.turns[0]:.0f} deg and the board by "
                f"{self.turns[1]:.0f}: check that the pairs belong together, and the convention and unit of the "
                "rotations"
            )
        return (
            f"{moves}; robot and board rotate alike, so their positions are wrong: check units, and which frame "
            "the positions are of"
        )

    def _otherwise(self, then: str) -> str:
        """List the interpretations that would make it consistent, the plausible ones first."""
        first, second = (self.likely, self.unlikely) if self.likely else (self.unlikely, ())
        said = f"; {then} if {', or if '.join(first)}" if first else ""
        return said + (
            f" (less plausible positions of camera and board: if {', or if '.join(second)})" if second else ""
        )

    @property
    def doubtful(self) -> bool:
        """Return whether the camera's position is more uncertain than the reported limit."""
        return self.fit.uncertainty_mm > RULE.doubtful_uncertainty_mm

    def scale_text(self, square_mm: float | None = None, *, advise: bool = True) -> str:
        """Name the board's scale with its interval, and what to do if `advise`."""
        scale, (low, high) = self.scaled.scale, self.scaled.scale_interval
        for factor, unit in NAMED_UNITS.items():
            for value, whose in ((factor, "board"), (1 / factor, "robot")):
                if abs(scale / value - 1) < 0.05:
                    return (
                        f"the {whose}'s positions are in {unit}, the other's in metres (factor {scale:.4g}): write "
                        "both in metres"
                    )
        given = square_mm or 30.0
        said = f"scale {scale:.3f} ({low:.3f} to {high:.3f})"
        if square_mm:
            what = f"the board's squares are {given * scale:.1f} mm, not {given:.1f}: {said}"
        else:
            what = f"the board's size is wrong: {said}; squares given as {given:.0f} mm are {given * scale:.1f} mm"
        return what + (
            "; measure the board and set its size, or use the fitted one with --fit-board-scale" if advise else ""
        )


def _mm(value: float) -> str:
    return f"{value:.1f} mm" if value < 100 else f"{value:.0f} mm" if np.isfinite(value) else "any distance"
