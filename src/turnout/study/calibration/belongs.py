"""Whether a calibration belongs to a panel."""

from turnout.panel.load import LoadedPanel
from turnout.study.calibration.record import Calibration


def doubts_on(calibration: Calibration, *panels: LoadedPanel) -> tuple[str, ...]:
    """Say that none of some panels is the one that was calibrated, by its hash.

    Parameters
    ----------
    calibration : Calibration
        Tells the hash of its panel.
    *panels : LoadedPanel
        The same panel before and after what a user sets.

    Returns
    -------
    tuple of str
        Empty where it belongs to one of them.
    """
    if calibration.panel_hash in [panel.hash for panel in panels]:
        return ()
    return (
        f"the calibration is of panel {calibration.panel} with hash {calibration.panel_hash[:12]}, "
        f"not of {panels[0].name} with hash {panels[0].hash[:12]}; its values are taken all the "
        "same",
    )
