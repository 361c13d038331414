"""Content that a studio is opened with: a panel, and perhaps a campaign."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from turnout.core.errors import FileError
from turnout.core.provenance import version
from turnout.core.toml import decode, read_bytes
from turnout.measurement.campaign.build_campaign import BuiltCampaign
from turnout.panel.load import LoadedPanel, library_names, library_text
from turnout.throw.compilation import must_compile
from turnout.web.controls import measured_record, panel_controls
from turnout.web.measured import campaign_movements
from turnout.web.tasks import Opening


def _text_of(panel: LoadedPanel) -> str:
    """Return the file that a panel was loaded from; empty if it is no longer there."""
    if panel.source in library_names():
        return library_text(panel.source)
    with suppress(OSError, FileError):
        return decode(read_bytes(Path(panel.source)), source=panel.source)
    return ""


@dataclass(frozen=True, slots=True)
class Opened:
    """A campaign and the folder that it is read from."""

    folder: Path
    campaign: BuiltCampaign


class Studio:
    """The panel that is shown first, and the movements of a campaign to lay over throws.

    Parameters
    ----------
    panel : LoadedPanel
        Panel that is shown first.
    opened : Opened, optional
        A campaign to lay over throws.
    """

    def __init__(self, panel: LoadedPanel, opened: Opened | None = None) -> None:
        self.opened = opened
        self._panel = panel
        found = list(campaign_movements(opened.campaign)) if opened else []
        self._campaign = {f"campaign-{number}": item for number, item in enumerate(found)}

    @property
    def opening(self) -> Opening:
        """Start data of the processes that compute."""
        folder = self.opened.folder if self.opened else None
        return Opening(self._panel, self._campaign, folder, _text_of(self._panel))

    def start(self) -> dict[str, Any]:
        """Return the data that the page needs to open."""
        return {
            "version": version(),
            "compiling": must_compile(),
            "library": list(library_names()),
            "panel": panel_controls(self._panel, self._panel.hash[:16]),
            "campaign": self._campaign_record(),
        }

    def _campaign_record(self) -> dict[str, Any] | None:
        if self.opened is None:
            return None
        campaign = self.opened.campaign
        return {
            "title": campaign.sheet.title,
            "synthetic": campaign.sheet.synthetic,
            "movements": [measured_record(k, item) for k, item in self._campaign.items()],
            "excluded": [
                f"{item.run.name}: {'; '.join(item.reasons)}" for item in campaign.excluded
            ],
            "files": sorted({run.file for run in campaign.sheet.runs}),
        }
