"""What fitted causes make of a panel and of its forces: predictions have them like the fit."""

from collections.abc import Mapping, Sequence

from turnout.calibration.candidate_causes import candidate_causes
from turnout.calibration.cause import Cause
from turnout.calibration.evaluate import Response
from turnout.calibration.parameter import Fitted
from turnout.panel.load import LoadedPanel


def fitted_causes(panel: LoadedPanel, parameters: Sequence[Fitted]) -> tuple[Cause, ...]:
    """Return the causes whose sizes are among the parameters of a calibration.

    Parameters
    ----------
    panel : LoadedPanel
        That was calibrated.
    parameters : sequence of Fitted
        All of a calibration; the sizes of causes have no keys of the panel.

    Returns
    -------
    tuple of Cause
        A cause that is a key of the panel, such as the modulus of the rails, is none of them: its
        value is set like any other.
    """
    planned = [item for item in parameters if item.keys]
    sizes = {item.name for item in parameters if not item.keys}
    return tuple(
        cause
        for cause in candidate_causes(panel, planned)
        if cause.parameters and all(item.name in sizes for item in cause.parameters)
    )


def overrides_with(
    causes: Sequence[Cause], parameters: Sequence[Fitted], values: Mapping[str, float]
) -> dict[str, object]:
    """Return the overrides of a panel at values by name of the parameter, causes included.

    Parameters
    ----------
    causes : sequence of Cause
        From `fitted_causes`.
    parameters : sequence of Fitted
        Of the calibration.
    values : mapping of str to float
        Of all of them, in SI.
    """
    found: dict[str, object] = {key: values[item.name] for item in parameters for key in item.keys}
    for cause in causes:
        if cause.law is not None:
            found |= cause.law(values)
    return found


def shaped(causes: Sequence[Cause], response: Response, values: Mapping[str, float]) -> Response:
    """Return a response as causes that are no part of the panel leave it, such as a recorder."""
    for cause in causes:
        if cause.shape is not None and not response.failure:
            response = cause.shape(response, values)
    return response
