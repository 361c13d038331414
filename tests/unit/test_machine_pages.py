"""What figures, findings and the studio show where drives are machines."""

import numpy as np
import xarray as xr

from turnout.figures.throw import throw_rows
from turnout.metric.finding import findings
from turnout.panel.load import load_panel
from turnout.web.controls import controls


def test_sliders_of_a_panel_with_machines() -> None:
    panel = load_panel("uic60-760-1-15")
    both = panel.with_overrides({"drive.1.machine": "jea73", "drive.2.machine": "jea73-drive2"})
    found = {item["key"]: item for item in controls(both)}
    voltage = found["machine.jea73.supply.voltage"]
    assert (voltage["value"], voltage["unit"]) == (220.0, "V")
    assert voltage["least"] < 176.0 < voltage["most"]
    assert "machine.jea73-drive2.supply.voltage" in found
    assert not [key for key in found if key.endswith(".duration")]  # machines take their own time
    one = controls(panel.with_overrides({"drive.1.machine": "jea73"}))
    assert [item["key"] for item in one if item["key"].endswith(".duration")]
    assert not [item for item in controls(panel) if item["key"].startswith("machine.")]


def test_a_marker_beside_a_machine_has_no_empty_curve() -> None:
    time = np.linspace(0.0, 1.0, 11)
    rows = np.array([np.ones(11), np.full(11, np.nan)])
    both = (("drive", "time"), np.ones((2, 11)))
    run = xr.Dataset(
        {
            "drive_displacement": both,
            "drive_slipping": (("drive", "time"), np.zeros((2, 11), dtype=bool)),
            "drive_current": (("drive", "time"), rows),
            "drive_power": (("drive", "time"), rows),
        },
        {"time": time, "drive": ["1", "2"]},
        {"movements": "[]"},
    )
    drawn = {label.split("\n")[0]: [c.label for c in curves] for label, curves in throw_rows(run)}
    assert drawn["Motor current,"] == drawn["Power drawn,"] == ["Drive 1"]
    assert drawn["Rod end"] == ["Drive 1", "Drive 2"]
    said = [item for item in findings(run) if item.question == "Did a drive slip?"]
    assert said[0].detail == "no clutch or bushing slipped"
    marked = run.drop_vars(["drive_current", "drive_power"])
    said = [item for item in findings(marked) if item.question == "Did a drive slip?"]
    assert said[0].detail == "every drive followed its marker"
