"""Truncation errors of a reduction: frequencies kept, static error, modal error, size."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.sparse as sp

from turnout.beam.craig_bampton import Matrix, Superelement
from turnout.beam.spectrum import factorise, modes_below

FloatArray = npt.NDArray[np.float64]

_SHIFT_SHARE = 0.05  # of the cut-off: what a free body is held by
_RIGID_SHARE = 1e-4  # of the cut-off: modes below this are rigid-body modes


@dataclass(frozen=True, slots=True, eq=False)
class ReductionReport:
    """Size and errors of a superelement against the structure that it stands for.

    Parameters
    ----------
    n_full, n_reduced, n_interface : int
        Numbers of DOFs.
    cutoff_frequency : float
        Requested [Hz].
    frequencies_kept : ndarray, shape (n_reduced - n_interface,)
        Fixed-interface frequencies [Hz].
    frequency_first_omitted : float
        Lowest fixed-interface frequency left out [Hz]; NaN if none was.
    static_error : float
        Largest error of the interface compliance, each entry relative to the root of the two
        diagonal ones it belongs to [-]; NaN if it was skipped.
    static_note : str
        Why the static error was skipped; empty if it was not.
    n_rigid : int
        Rigid-body modes of the full structure.
    frequencies_full, frequencies_reduced : ndarray, shape (n_modes,)
        Elastic frequencies with free interface up to the cut-off [Hz], in increasing order.
    """

    n_full: int
    n_reduced: int
    n_interface: int
    cutoff_frequency: float
    frequencies_kept: FloatArray
    frequency_first_omitted: float
    static_error: float
    static_note: str
    n_rigid: int
    frequencies_full: FloatArray
    frequencies_reduced: FloatArray

    @property
    def dof_share(self) -> float:
        """Reduced DOFs divided by full ones [-]."""
        return self.n_reduced / self.n_full

    @property
    def modal_error(self) -> FloatArray:
        """Relative error of each free-interface frequency [-]; never negative but for rounding."""
        return self.frequencies_reduced / self.frequencies_full - 1.0

    def __str__(self) -> str:
        """Return the text of `format_report`."""
        return format_report(self)


def reduction_report(
    superelement: Superelement, stiffness: Matrix, mass: Matrix
) -> ReductionReport:
    """Compare a superelement with the full structure.

    Parameters
    ----------
    superelement : Superelement
        As made from the two matrices by `turnout.beam.craig_bampton.craig_bampton`.
    stiffness, mass : sparse array or ndarray, shape (n, n)
        The stiffness may be singular (a free body); the static error is then skipped.

    Returns
    -------
    ReductionReport
        Errors up to the cut-off frequency of the superelement.

    Examples
    --------
    >>> from turnout.beam.craig_bampton import craig_bampton
    >>> chain = sp.diags_array([[-1.0] * 8, [2.0] * 9, [-1.0] * 8], offsets=[-1, 0, 1])
    >>> reduced = craig_bampton(chain, sp.eye_array(9), [4], cutoff_frequency=0.15)
    >>> report = reduction_report(reduced, chain, sp.eye_array(9))
    >>> print(str(report).splitlines()[0])
    3 of 9 DOFs (33.3 %): 1 at the interface, 2 modes
    >>> bool(report.static_error < 1e-12), (report.modal_error.round(4) + 0.0).tolist()
    (True, [0.0034, 0.0, 0.1176])
    """
    full_stiffness: sp.csr_array = _as_sparse(stiffness)
    full_mass: sp.csr_array = _as_sparse(mass)
    error, note = static_error(superelement, full_stiffness)
    full, reduced = _free_frequencies(superelement, full_stiffness, full_mass)
    n_rigid = int(np.count_nonzero(full < _RIGID_SHARE * superelement.cutoff_frequency))
    return ReductionReport(
        n_full=superelement.transformation.shape[0],
        n_reduced=superelement.transformation.shape[1],
        n_interface=superelement.n_interface,
        cutoff_frequency=superelement.cutoff_frequency,
        frequencies_kept=superelement.frequencies_kept,
        frequency_first_omitted=superelement.frequency_first_omitted,
        static_error=error,
        static_note=note,
        n_rigid=n_rigid,
        frequencies_full=full[n_rigid:],
        frequencies_reduced=reduced[n_rigid:],
    )


def format_report(report: ReductionReport, *, most_modes: int = 10) -> str:
    """Format a report as text.

    Parameters
    ----------
    report : ReductionReport
        From `reduction_report`.
    most_modes : int
        Length of the table of free-interface frequencies; the last line is the worst of all modes.

    Returns
    -------
    str
        Several lines, without a newline at the end.
    """
    kept = report.frequencies_kept
    lines = [
        f"{report.n_reduced} of {report.n_full} DOFs ({100.0 * report.dof_share:.1f} %): "
        f"{report.n_interface} at the interface, {kept.size} modes"
    ]
    band = f"{kept[0]:.4g} to {kept[-1]:.4g} Hz" if kept.size else "none"
    omitted = report.frequency_first_omitted
    lines.append(
        f"modes kept with fixed interface: {band}, cut-off {report.cutoff_frequency:g} Hz, "
        + (f"first left out {omitted:.4g} Hz" if np.isfinite(omitted) else "none left out")
    )
    static = report.static_note or f"{report.static_error:.0e}"
    lines.append(f"static error of the interface compliance: {static}")
    if report.n_rigid:
        lines.append(f"rigid-body modes: {report.n_rigid}")
    errors = report.modal_error
    if errors.size:
        lines.append("free interface:  full [Hz]   reduced [Hz]   relative error")
        lines += [
            f"  mode {number + 1:3d}  {full:14.5g} {reduced:14.5g} {error:16.1e}"
            for number, (full, reduced, error) in enumerate(
                zip(report.frequencies_full, report.frequencies_reduced, errors, strict=True)
            )
            if number < most_modes
        ]
        lines.append(f"largest of {errors.size} modal errors: {np.abs(errors).max():.1e}")
    return "\n".join(lines)


def static_error(superelement: Superelement, stiffness: sp.csr_array) -> tuple[float, str]:
    """Return the `static_error` and `static_note` of a `ReductionReport`.

    The shapes of the superelement may be those of another structure.
    """
    interface = superelement.interface
    if not interface.size:
        return float("nan"), "skipped: there is no interface"
    factor = factorise(stiffness)
    if factor is None:
        return float("nan"), "skipped: the stiffness is singular, the body is free"
    loads = np.zeros((stiffness.shape[0], interface.size))
    loads[interface, np.arange(interface.size)] = 1.0
    full = factor.solve(loads)[interface]
    count = interface.size
    within, across = superelement.stiffness, superelement.stiffness[:count, count:]
    condensed = within[:count, :count]
    if across.any():
        condensed = condensed - across @ np.linalg.solve(within[count:, count:], across.T)
    reduced = np.linalg.inv(condensed)
    scale = np.sqrt(np.diag(full))
    return float(np.max(np.abs(reduced - full) / (scale[:, None] * scale))), ""


def _free_frequencies(
    superelement: Superelement, stiffness: sp.csr_array, mass: sp.csr_array
) -> tuple[FloatArray, FloatArray]:
    """Find the frequencies [Hz] of the full structure up to the cut-off and their counterparts."""
    cutoff = superelement.cutoff_frequency
    if cutoff == 0.0:
        return np.zeros(0), np.zeros(0)
    shift = -((2.0 * np.pi * _SHIFT_SHARE * cutoff) ** 2)
    full, _, _ = modes_below(stiffness, mass, cutoff_frequency=cutoff)
    size = superelement.stiffness.shape[0]
    if not full.size:
        return full, full
    # The inverse problem admits reduced DOFs without mass. The full structure has no more modes
    # below the cut-off than there are reduced DOFs, since all fixed-interface ones were kept.
    theta = scipy.linalg.eigh(
        superelement.mass,
        superelement.stiffness - shift * superelement.mass,
        eigvals_only=True,
        subset_by_index=[size - full.size, size - 1],
    )[::-1]
    return full, np.sqrt(np.maximum(1.0 / theta + shift, 0.0)) / (2.0 * np.pi)


def _as_sparse(matrix: Any) -> sp.csr_array:
    sparse: sp.csr_array = sp.csr_array(matrix)
    return sparse
