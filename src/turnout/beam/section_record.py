"""The record of cross-section constants that beams are made of, and its change along the rail.

Axes: x along the rail, y lateral, z up; positions are measured from the rail's reference line.
Second moments are about axes through the centroid, parallel to y and z (not principal axes).
"""

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from turnout.core.errors import MechanicsError

FloatArray = npt.NDArray[np.float64]

_POSITIVE = (
    "area",
    "second_moment_vertical",
    "second_moment_lateral",
    "torsion_constant",
    "shear_factor_vertical",
    "shear_factor_lateral",
)
_ODD_IN_Y = ("centroid_y", "shear_centre_y", "product_moment")


@dataclass(frozen=True, slots=True, eq=False)
class SectionProperties:
    """Cross-section constants, one entry a station or element.

    Every field is an array of the same shape (n,).

    Parameters
    ----------
    area : ndarray, shape (n,)
        Area A [m^2], positive.
    second_moment_vertical : ndarray, shape (n,)
        I_y, the integral of z^2 about the centroid [m^4]; resists vertical bending.
    second_moment_lateral : ndarray, shape (n,)
        I_z, the integral of y^2 about the centroid [m^4]; resists lateral bending.
    product_moment : ndarray, shape (n,)
        I_yz, the integral of y z about the centroid [m^4]; either sign, I_yz^2 < I_y I_z.
    torsion_constant : ndarray, shape (n,)
        Saint-Venant torsion constant J [m^4].
    shear_factor_vertical, shear_factor_lateral : ndarray, shape (n,)
        Shear area divided by area, for shear along z and along y [-].
    centroid_y, centroid_z : ndarray, shape (n,)
        Position of the centroid [m].
    shear_centre_y, shear_centre_z : ndarray, shape (n,)
        Position of the shear centre [m].

    Raises
    ------
    MechanicsError
        If the shapes differ, a value is not finite, or one that must be positive is not.
    """

    area: FloatArray
    second_moment_vertical: FloatArray
    second_moment_lateral: FloatArray
    product_moment: FloatArray
    torsion_constant: FloatArray
    shear_factor_vertical: FloatArray
    shear_factor_lateral: FloatArray
    centroid_y: FloatArray
    centroid_z: FloatArray
    shear_centre_y: FloatArray
    shear_centre_z: FloatArray

    def __post_init__(self) -> None:
        """Refuse impossible section properties, with all problems in one message."""
        values = _to_dict(self)
        shapes = {name: np.shape(value) for name, value in values.items()}
        if len(set(shapes.values())) != 1 or len(shapes["area"]) != 1:
            msg = f"section properties must be 1-D arrays of one length, not {shapes}"
            raise MechanicsError(msg)
        problems = [name for name, value in values.items() if not np.isfinite(value).all()]
        problems = [f"{name} is not finite" for name in problems]
        problems += [
            f"{name} must be positive (least value {values[name].min():g})"
            for name in _POSITIVE
            if np.any(values[name] <= 0.0)
        ]
        product = self.second_moment_vertical * self.second_moment_lateral
        if np.any(self.product_moment**2 >= product) and not problems:
            problems.append("product_moment^2 must be less than the product of the second moments")
        if problems:
            msg = "not a cross-section: " + "; ".join(problems)
            raise MechanicsError(msg)


def interpolate_sections(
    stations: npt.ArrayLike, properties: SectionProperties, x: npt.ArrayLike
) -> SectionProperties:
    """Interpolate properties linearly along the rail; the end values are held beyond the ends.

    Parameters
    ----------
    stations : array_like, shape (n,)
        Positions of the sections [m], never decreasing. A position given twice is a step.
    properties : SectionProperties
        n entries, one a station.
    x : array_like, shape (m,)
        Positions, anywhere along the rail [m].

    Returns
    -------
    SectionProperties
        m entries.

    Examples
    --------
    >>> ones = np.ones(2)
    >>> ends = SectionProperties(np.array([1.0, 3.0]), *[ones] * 2, 0 * ones, *[ones] * 7)
    >>> interpolate_sections([0.0, 2.0], ends, [-1.0, 0.5, 9.0]).area.tolist()
    [1.0, 1.5, 3.0]
    """
    at = np.asarray(stations, dtype=float)
    wanted = np.asarray(x, dtype=float)
    if at.shape != properties.area.shape or at.size == 0:
        msg = f"{at.size} stations were given for {properties.area.size} sections"
        raise MechanicsError(msg)
    if np.any(np.diff(at) < 0.0):
        msg = f"the stations must not decrease: {at.tolist()}"
        raise MechanicsError(msg)
    values = _to_dict(properties)
    return SectionProperties(**{name: np.interp(wanted, at, v) for name, v in values.items()})


def mirror_sections(properties: SectionProperties) -> SectionProperties:
    """Return the sections mirrored in the vertical plane y = 0 of the reference line.

    The lateral positions and the product of inertia change sign; all else stays.

    Examples
    --------
    >>> one = np.ones(1)
    >>> section = SectionProperties(*[one] * 3, 0.5 * one, *[one] * 7)
    >>> mirror = mirror_sections(section)
    >>> float(mirror.product_moment[0]), float(mirror.centroid_z[0])
    (-0.5, 1.0)
    """
    values = _to_dict(properties)
    values.update({name: -values[name] for name in _ODD_IN_Y})
    return SectionProperties(**values)


def _to_dict(properties: SectionProperties) -> dict[str, FloatArray]:
    return {field.name: getattr(properties, field.name) for field in fields(SectionProperties)}
