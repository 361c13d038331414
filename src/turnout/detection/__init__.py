"""Detection of a trapped object: floor, bound, training, verdicts."""

from turnout.core.lazy import loader

NAMES = {
    "Detector": "turnout.detection.detector.detector",
    "Verdict": "turnout.detection.detector.throw_verdict",
    "Recorded": "turnout.detection.detector.recorded",
    "Allowances": "turnout.detection.detector.allowances",
    "Counts": "turnout.detection.detector.training_sets",
    "read_throws": "turnout.detection.detector.reading",
    "train": "turnout.detection.detector.train_detector:train_detector",
}

__all__ = sorted(NAMES)  # noqa: PLE0605 - follows from the table
__getattr__ = loader("turnout.detection", NAMES)


def __dir__() -> list[str]:
    return list(__all__)
