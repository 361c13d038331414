"""A small virtual campaign that several tests use, made once a session."""

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

from tests.unit.simulated import sb2_panel

from turnout.measurement.campaign.build_campaign import build_campaign_dataset
from turnout.measurement.campaign.campaign_folder import STORE
from turnout.study.virtual.campaign_plan import CampaignPlan
from turnout.study.virtual.make_campaign import make_virtual_campaign

PLAN = CampaignPlan(
    places=("sleeper 6",),
    sizes=(0.010, 0.013, 0.031),
    object_free=3,
    formats=(".csv", ".mat"),
    seed=5,
)


@cache
def made() -> Path:
    """Return a folder that no test may change."""
    folder = Path(tempfile.mkdtemp()) / "small"
    atexit.register(shutil.rmtree, folder.parent, ignore_errors=True)
    make_virtual_campaign(sb2_panel(), folder, plan=PLAN)
    return folder


@cache
def cut() -> Path:
    """Return a folder with what a build keeps of each recording."""
    folder = copied(Path(tempfile.mkdtemp()), built=False)
    atexit.register(shutil.rmtree, folder.parent, ignore_errors=True)
    build_campaign_dataset(folder)
    return folder / STORE


def copied(folder: Path, *, built: bool = True) -> Path:
    """Return a copy that a test may change, of a campaign that was built before or was not."""
    target = folder / "campaign"
    shutil.copytree(made(), target, ignore=shutil.ignore_patterns(STORE, ".virtual"))
    if built:
        shutil.copytree(cut(), target / STORE)
    return target


def edited(folder: Path, old: str, new: str) -> Path:
    """Change a text of the run sheet, which must be there."""
    sheet = folder / "runs.csv"
    text = sheet.read_text(encoding="utf-8")
    assert old in text
    sheet.write_text(text.replace(old, new), encoding="utf-8")
    return folder
