"""The linear elastic, isotropic material of a beam."""

from dataclasses import dataclass

from turnout.core.errors import MechanicsError


@dataclass(frozen=True, slots=True, kw_only=True)
class ElasticMaterial:
    """Linear elastic, isotropic material.

    Parameters
    ----------
    youngs_modulus : float
        E [Pa], positive.
    poisson_ratio : float
        nu [-], above -1 and below 0.5.
    density : float
        rho [kg/m^3], positive.

    Examples
    --------
    >>> steel = ElasticMaterial(youngs_modulus=210e9, poisson_ratio=0.3, density=7850.0)
    >>> round(steel.shear_modulus / 1e9, 2)
    80.77
    """

    youngs_modulus: float
    poisson_ratio: float
    density: float

    def __post_init__(self) -> None:
        """Refuse a material that stores negative energy or has no mass."""
        bounds = {
            "youngs_modulus": (self.youngs_modulus > 0.0, "above 0"),
            "poisson_ratio": (-1.0 < self.poisson_ratio < 0.5, "between -1 and 0.5"),
            "density": (self.density > 0.0, "above 0"),
        }
        problems = [
            f"{name} is {getattr(self, name)}, allowed is {allowed}"
            for name, (valid, allowed) in bounds.items()
            if not valid
        ]
        if problems:
            raise MechanicsError("; ".join(problems))

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)) [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))
