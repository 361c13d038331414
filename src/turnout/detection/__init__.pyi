"""Written by `python -m turnout.api.stub` from the table in __init__.py."""

from turnout.detection.detector.allowances import Allowances as Allowances
from turnout.detection.detector.detector import Detector as Detector
from turnout.detection.detector.reading import read_throws as read_throws
from turnout.detection.detector.recorded import Recorded as Recorded
from turnout.detection.detector.throw_verdict import Verdict as Verdict
from turnout.detection.detector.train_detector import train_detector as train
from turnout.detection.detector.training_sets import Counts as Counts

__all__ = [
    "Allowances",
    "Counts",
    "Detector",
    "Recorded",
    "Verdict",
    "read_throws",
    "train",
]
