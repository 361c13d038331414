"""Force from the current of a point machine: never without an anchor that says what an ampere is.

A current alone gives amperes. Newtons need a slope that something else has measured: forces at the
same drive (load cell, gauged rod), the force at which its clutch slips (a gauge in the lock
opening), or a sister machine, whose slope is known with a spread from machine to machine.
"""

import math
from dataclasses import dataclass
from typing import Literal

from turnout.calibration.machine_estimates.current_fit import Estimate, TorqueCurve
from turnout.core.errors import MachineError

AnchorKind = Literal["force at the drive", "clutch-force gauge", "sister machine"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceAnchor:
    """Force per ampere of a machine, and its source.

    Attributes
    ----------
    kind : {"force at the drive", "clutch-force gauge", "sister machine"}
    slope, slope_deviation : float
        Rise of the current with the force, and its standard deviation [A/N].
    idle, idle_deviation : float
        Current without force [A].
    covariance : float
        Of slope and idle current, whose errors go together where both come from one fit or one
        from the other [A^2/N].
    scale_deviation : float
        Part of the slope's deviation that scales all forces alike, as a share of it: an error of
        the gauge that they come from [-].
    series : tuple of float or None
        Of a series motor, whose torque goes by i^2/(1 + i/i_s): the force at the end of the chord
        that `slope` is [N], and i_s [A]. None: the current rises straight.
    """

    kind: AnchorKind
    slope: float
    slope_deviation: float
    idle: float
    idle_deviation: float
    covariance: float = 0.0
    scale_deviation: float = 0.0
    series: tuple[float, float] | None = None

    def force(self, current: float, *, deviation: float = 0.0) -> Estimate:
        """Return the force at a current, with its standard deviation and 95 % interval [N].

        Parameters
        ----------
        current, deviation : float
            [A].

        Examples
        --------
        >>> anchor = Gauge(force=6000.0, deviation=120.0).anchor(slip_current=2.0, idle=0.8)
        >>> force = anchor.force(1.4)
        >>> round(force.value), round(force.deviation)
        (3000, 60)

        Notes
        -----
        dF/di_0 and dF/dslope are both negative, of which the code carries the opposites: the sign
        of their product in the covariance's term is the same.
        """
        reference, saturation = self.series or (1.0, None)
        curve, top = TorqueCurve(saturation), self.idle + self.slope * reference
        torques = [curve.torque(i) for i in (current, self.idle, top)]
        rises = [curve.slope(i) for i in (current, self.idle, top)]
        above, whole = torques[0] - torques[1], torques[2] - torques[1]
        force = reference * above / whole
        by_idle = (rises[1] * whole + above * (rises[2] - rises[1])) * reference / whole**2
        by_slope = force * reference * rises[2] / whole
        variance = (deviation * reference * rises[0] / whole) ** 2
        bent = self.slope_deviation**2 - (self.slope * self.scale_deviation) ** 2
        variance += (self.idle_deviation * by_idle) ** 2 + max(bent, 0.0) * by_slope**2
        variance += (self.scale_deviation * force) ** 2
        variance += 2.0 * self.covariance * by_idle * by_slope
        return Estimate.of(force, 0.0, 1, common=math.sqrt(max(variance, 0.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Gauge:
    """Force at which a clutch slips, from a gauge, and its standard deviation [N]."""

    force: float
    deviation: float

    def anchor(
        self,
        *,
        slip_current: float,
        idle: float,
        slip_deviation: float = 0.0,
        idle_deviation: float = 0.0,
        saturation_current: float | None = None,
    ) -> ForceAnchor:
        """Return the anchor that it gives: slope = (i_s - i_0)/F.

        Parameters
        ----------
        slip_current, slip_deviation : float
            While the clutch slips [A].
        idle, idle_deviation : float
            Without force on the rod, such as with the rod taken off [A].
        saturation_current : float, optional
            Of a series motor [A]; left out, the current rises straight.

        Raises
        ------
        MachineError
            When force or currents cannot be.
        """
        force, deviation = self.force, self.deviation
        if not (force > 0.0 and deviation >= 0.0 and slip_current > idle > 0.0):
            text = (
                f"clutch force {force:g} N +- {deviation:g} N at {slip_current:.4g} A, idle "
                f"{idle:.4g} A: needs a force above 0 and a slip current above the idle current"
            )
            raise MachineError([text], source="clutch-force gauge")
        slope = (slip_current - idle) / force
        relative = math.hypot(
            math.hypot(slip_deviation, idle_deviation) / (slip_current - idle), deviation / force
        )
        return ForceAnchor(
            kind="clutch-force gauge",
            slope=slope,
            slope_deviation=slope * relative,
            idle=idle,
            idle_deviation=idle_deviation,
            scale_deviation=deviation / force,
            covariance=-(idle_deviation**2) / force,  # slope = (i_s - i_0)/F falls as i_0 rises
            series=None if saturation_current is None else (force, saturation_current),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Sister:
    """Knowledge of a machine of the same type.

    Attributes
    ----------
    slope, spread : float
        Rise of its current with the force, and the standard deviation of that from machine to
        machine [A/N].
    reference : float, optional
        Of series motors: force up to which `slope` is the mean rise from no force [N].
    idle : float, optional
        Of series motors: its current without force; default that of the drive itself [A].
    """

    slope: float
    spread: float
    reference: float | None = None
    idle: float | None = None

    def anchor(self, *, idle: float, saturation_current: float | None = None) -> ForceAnchor:
        """Return the anchor that it gives another machine.

        Parameters
        ----------
        idle : float
            Current of that machine without force [A].
        saturation_current : float, optional
            Of series motors [A]; left out, the current rises straight.

        Raises
        ------
        MachineError
            When the slope is not positive, no spread is given (sister machines are never equal),
            or a series motor lacks the reference force.

        Notes
        -----
        What two series motors of a type share is the rise of g(i) = i^2/(1 + i/i_s) with the
        force, not that of the current, which is smaller the higher the current already is.
        """
        slope, spread, reference, series = self.slope, self.spread, self.reference, None
        if not (slope > 0.0 and spread > 0.0 and idle > 0.0):
            text = (
                f"sister machine {1e3 * slope:g} A/kN +- {1e3 * spread:g} A/kN, idle {idle:g} A: "
                "all three must be above 0; the spread is that from machine to machine"
            )
            raise MachineError([text], source="sister machine")
        if saturation_current is not None:
            if reference is None or not reference > 0.0:
                text = (
                    "the current of a series motor does not rise straight: give the reference "
                    "force up to which the sister's rise was taken, such as 'to 4 kN'"
                )
                raise MachineError([text], source="sister machine")
            start = idle if self.idle is None else self.idle
            top = start + slope * reference
            curve = TorqueCurve(saturation_current)
            own_top = curve.current(curve.torque(idle) + curve.torque(top) - curve.torque(start))
            spread *= curve.slope(top) / curve.slope(own_top)
            slope = (own_top - idle) / reference
            series = (reference, saturation_current)
        return ForceAnchor(
            kind="sister machine",
            slope=slope,
            slope_deviation=spread,
            idle=idle,
            idle_deviation=0.0,
            series=series,
        )
