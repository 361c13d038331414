"""Whether a calibration belongs to a panel, and is to be trusted."""

from turnout.panel.load import LoadedPanel
from turnout.study.calibration.record import Calibration


def doubts_on(calibration: Calibration, *panels: LoadedPanel) -> tuple[str, ...]:
    """Say why a calibration is not to be trusted, and that it is of none of some panels, by hash.

    Parameters
    ----------
    calibration : Calibration
        Tells the hash of its panel.
    *panels : LoadedPanel
        The same panel before and after what a user sets.

    Returns
    -------
    tuple of str
        Empty where it is to be trusted and belongs to one of them.
    """
    found = tuple(f"is not to be trusted: {text}" for text in calibration.distrust)
    if calibration.panel_hash in [panel.hash for panel in panels]:
        return found
    return (
        *found,
        f"the calibration is of panel {calibration.panel} with hash {calibration.panel_hash[:12]}, "
        f"not of {panels[0].name} with hash {panels[0].hash[:12]}; its values are taken all the "
        "same",
    )
