"""A machine of which a perfect clamp records a movement."""

import numpy as np
import xarray as xr

from turnout.study.virtual.record_throw import Window, record_throw


def test_a_motor_that_still_braked_is_off_before_the_next_movement() -> None:
    """A slow opening whose braking current flows until 50 ms before the closing command."""
    time = np.arange(0.0, 9.0, 0.01)
    current = np.where(time < 4.0, -1.1, 0.0)
    current[(time >= 4.0) & (time < 4.35)] = 0.2
    current[(time >= 4.4) & (time < 7.8)] = 1.2
    rows = {"drive_current": current, "drive_force": 0.0 * time, "drive_displacement": 0.03 * time}
    run = xr.Dataset(
        {name: (("drive", "time"), row[None]) for name, row in rows.items()}
        | {
            "drive_slipping": (("drive", "time"), np.zeros((1, time.size), dtype=bool)),
            "object_force": ("time", 0.0 * time),
        },
        {"time": time, "drive": ["1"], "saturation_force": ("drive", [6e3])},
        {
            "movements": '[{"name": "a", "to": "open", "start": 0.2, "end": 4.1},'
            ' {"name": "b", "to": "closed", "start": 4.4, "end": 7.9}]'
        },
    )
    made = record_throw(run, direction="closing", window=Window())
    rest = made["drive_current"].sel(time=slice(None, made.attrs["onset"] - 0.01))
    assert rest.size > 10
    assert not rest.any()
    assert float(made["drive_current"].max()) == 1.2
