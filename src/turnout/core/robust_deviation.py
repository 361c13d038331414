"""The standard deviation of a normal distribution from the median of absolute deviations."""

MAD_TO_SIGMA = 1.4826
r""":math:`1 / \Phi^{-1}(3/4)`: half of all normal numbers lie within 0.6745 deviations [-]."""
