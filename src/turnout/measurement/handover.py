"""What a reader in a process of its own leaves behind: numbers, and a header that says what."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

HEADER, ARRAYS, FAULT = "header.json", "arrays.npz", "fault"


@dataclass(slots=True)
class Handover:
    """Channels collected by a reader, to be read by `turnout.measurement.isolated`."""

    start_time: str | None = None
    problems: list[str] = field(default_factory=list)
    channels: list[dict[str, Any]] = field(default_factory=list)
    arrays: dict[str, Any] = field(default_factory=dict)

    def add(
        self,
        name: str,
        values: Any,
        *,
        unit: str,
        description: str,
        rate: float | None = None,
        start: float = 0.0,
        time: Any = None,
    ) -> None:
        """Keep a channel with its rate and start, or with its times."""
        key, time_key = f"values{len(self.channels)}", ""
        if time is not None:
            # Channels of a group share their times, which are kept once.
            shared = (item for item in self.arrays if item.startswith("time"))
            time_key = next((k for k in shared if np.array_equal(self.arrays[k], time)), "")
            time_key = time_key or f"time{len(self.channels)}"
            self.arrays[time_key] = time
        self.arrays[key] = values
        self.channels.append(
            {
                "name": name,
                "unit": unit,
                "description": description,
                "rate": rate,
                "start": start,
                "values": key,
                "time": time_key,
            }
        )

    def leave_out(self, name: str, reason: object) -> None:
        """Say why a channel is not among them."""
        self.problems.append(f"channel '{name}' is left out: {reason}")

    def save(self, folder: Path) -> None:
        """Write both files; the header last, as a sign that all is there."""
        np.savez(folder / ARRAYS, **self.arrays)
        header = {
            "start_time": self.start_time,
            "problems": self.problems,
            "channels": self.channels,
        }
        (folder / HEADER).write_text(json.dumps(header), encoding="utf-8")


def save_fault(folder: Path, error: object) -> None:
    """Write that the file cannot be read at all, and why."""
    (folder / HEADER).write_text(json.dumps({FAULT: str(error)}), encoding="utf-8")
