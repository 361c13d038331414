"""The Gamma circuit of an induction motor in the steady state, seen from its terminals.

With the stator's flux as the reference, in a frame that turns with w_k, at the slip speed
s = w_k - n_p w1 (electrical):

    i_s = lambda psi_s,    lambda = 1/L_s + j s/(R_r + j s L_l),    Z = R_s + j w_k/lambda

At the slip S = s/w_k this is R_s in series with jX_s parallel to jX_l + R_r/S, and it is finite at
synchronous speed, S = 0.
"""

from turnout.kernels.compiled import compiled_part


def gamma_impedance(
    frame: float,
    slip_speed: float,
    resistances: tuple[float, float],
    inductances: tuple[float, float],
) -> tuple[complex, complex, complex]:
    """Return stator current per flux [1/H], impedance [ohm], and the rotor's own impedance [ohm].

    Parameters
    ----------
    frame : float
        w_k, electrical [rad/s]; negative of a system that turns backwards.
    slip_speed : float
        [rad/s]; an array where Python calls this.
    resistances : tuple of float
        R_s and R_r [ohm].
    inductances : tuple of float
        L_s and L_l [H].
    """
    rotor = resistances[1] + 1j * slip_speed * inductances[1]
    per_flux = 1.0 / inductances[0] + 1j * slip_speed / rotor
    return per_flux, resistances[0] + 1j * frame / per_flux, rotor


gamma_circuit = compiled_part(gamma_impedance)
"""`gamma_impedance` for kernels."""
