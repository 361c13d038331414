"""What can be seen of a trapped object, and the detector: floor, bound, training, verdicts."""

from turnout.lazy import loader

NAMES = {
    "Detector": "turnout.detection.detector",
    "Verdict": "turnout.detection.throw_verdict",
    "Recorded": "turnout.detection.recorded",
    "Allowances": "turnout.detection.allowances",
    "Counts": "turnout.detection.training_sets",
    "open_benchmark": "turnout.open_benchmark.sides",
    "read_throws": "turnout.detection.reading",
    "train": "turnout.detection.train_detector:train_detector",
}

__all__ = sorted(NAMES)  # noqa: PLE0605 - follows from the table
__getattr__ = loader("turnout.detection", NAMES)


def __dir__() -> list[str]:
    return list(__all__)
