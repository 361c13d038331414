"""Which process runs which tests: files stay whole, long ones go first, browsers share one.

Files that are not named here are short; they fill what is left at the end.
"""

import pytest
from xdist.scheduler import LoadFileScheduling

LONG = (
    "tests/faults/test_hostile_recordings.py",
    "tests/unit/test_detector.py",
    "tests/unit/test_open_benchmark_methods.py",
    "tests/faults/test_studio_freeze.py",
    "tests/faults/test_calibrate_interrupt.py",
    "tests/faults/test_outside_files.py",
    "tests/verification/test_robustness_properties.py",
    "tests/verification/test_calibration_twin.py",
    "tests/unit/test_measurement_campaign.py",
    "tests/verification/test_independent_switch.py",
    "tests/verification/test_paper_facts.py",
    "tests/gallery/test_gallery.py",
    "tests/faults/test_sweep_damage.py",
    "tests/unit/test_open_benchmark_throws.py",
    "tests/faults/test_virtual_interrupt.py",
    "tests/faults/test_sweep_killed.py",
    "tests/unit/test_detection_known_place.py",
    "tests/unit/test_web_studio.py",
    "tests/unit/test_public_api.py",
    "tests/verification/test_studies.py",
    "tests/verification/test_validation_other_panel.py",
    "tests/faults/test_detection_limit.py",
    "tests/unit/test_calibration_causes.py",
    "tests/gallery/test_readme.py",
    "tests/faults/test_cache_folder.py",
    "tests/faults/test_cli_campaign.py",
    "tests/unit/test_web_detecting.py",
    "tests/faults/test_detector_recordings.py",
    "tests/unit/test_detector_calibrating.py",
    "tests/unit/test_detector_another_switch.py",
    "tests/unit/test_web_worker.py",
    "tests/unit/test_detection_pod.py",
    "tests/unit/test_detection_throws.py",
    "tests/unit/test_measurement_optional.py",
    "tests/unit/test_cli_simulate.py",
    "tests/verification/test_brute_force_agreement.py",
    "tests/layers/test_words.py",
)
"""From the longest to one of 6 s; last in a run, one would keep a process while the other waits."""
BROWSER = (
    "tests/browser/test_report.py",
    "tests/browser/test_studio_detection.py",
    "tests/browser/test_studio_page.py",
    "tests/browser/test_studio_work.py",
)
"""Share one studio and one page of a browser."""
RANK = {name: number for number, name in enumerate((*BROWSER, *LONG))}


def ordered(items: list[pytest.Item]) -> list[pytest.Item]:
    """Return tests in the order in which their files are begun."""
    return sorted(items, key=lambda item: RANK.get(file_of(item.nodeid), len(RANK)))


def file_of(nodeid: str) -> str:
    return nodeid.split("::", 1)[0]


class LongFirst(LoadFileScheduling):
    """Give out whole files in the order of collection."""

    def __init__(self, config: pytest.Config, log: object = None) -> None:
        # Files with the most tests would come first.
        config.option.loadscopereorder = False
        super().__init__(config, log)

    def _split_scope(self, nodeid: str) -> str:
        file = file_of(nodeid)
        return BROWSER[0] if file in BROWSER else file
