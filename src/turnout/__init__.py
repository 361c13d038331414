"""turnout simulates how a railway switch is thrown, with or without a trapped foreign object.

>>> import turnout
>>> panel = turnout.load_panel("uic60-760-1-15")
>>> obj = turnout.ForeignObject(size=0.013, at="sleeper 6")
>>> dataset = turnout.simulate(panel, foreign_object=obj)  # doctest: +SKIP
>>> dataset.turnout.summary()  # doctest: +SKIP

The public interface is what this package, `turnout.detection` and `turnout.figures` list in
``__all__``, and the methods of what these return. All modules below are private: they may move or
change in any version.

Everything is loaded on first use, so that importing turnout costs nothing.
"""

import sys

from turnout.core.lazy import loader

NAMES = {
    # Panels and objects
    "load_panel": "turnout.calibration.load_study:load_panel_or_case",
    "panel_names": "turnout.panel.load:library_names",
    "LoadedPanel": "turnout.panel.load",
    "ForeignObject": "turnout.panel.foreign_object",
    "analyse_outline": "turnout.beam.section_analysis",
    "make_outline": "turnout.beam.outline",
    # One throw
    "simulate": "turnout.throw.simulate",
    "simulate_sequence": "turnout.throw.sequence",
    "Drift": "turnout.throw.drift",
    "Scheme": "turnout.core.scheme",
    "Save": "turnout.throw.save",
    "open_response": "turnout.throw.store",
    "save_response": "turnout.throw.store",
    "gauge_under_wheel": "turnout.throw.wheel",
    "modes": "turnout.metric.modes",
    "friction_stability": "turnout.metric.stability",
    "features": "turnout.metric.features",
    "filtered": "turnout.metric.channel_features",
    # Point machines
    "load_machines": "turnout.machine.machine_file",
    "LoadedMachines": "turnout.machine.machine_file",
    "throw_one_mass": "turnout.throw.machine",
    "MachineThrow": "turnout.throw.machine",
    "machine_dataset": "turnout.throw.machine",
    "fit_machines": "turnout.api.machine",
    "fit_three_phase": "turnout.api.machine",
    "ThreePhaseFit": "turnout.calibration.machine_estimates.three_phase",
    "Monitoring": "turnout.measurement.chain.monitoring",
    "monitored": "turnout.measurement.chain.monitoring",
    "MachineFit": "turnout.calibration.machine_estimates.machine_fit",
    # Measurements, calibration, validation
    "read_recording": "turnout.measurement.formats.file_format",
    "import_recording": "turnout.api.recording",
    "read_history": "turnout.measurement.formats.history",
    "Campaign": "turnout.api.campaign",
    "load_campaign": "turnout.api.campaign",
    "build_campaign": "turnout.api.campaign",
    "CalibrationResult": "turnout.api.calibration",
    "calibrate": "turnout.api.calibration",
    "load_calibration": "turnout.api.calibration",
    "Validation": "turnout.api.validation",
    "validate": "turnout.api.validation",
    # Studies of many throws
    "load_study": "turnout.calibration.load_study",
    "Sweep": "turnout.api.sweep",
    "run_sweep": "turnout.api.sweep",
    "open_sweep": "turnout.api.sweep",
    "compile": "turnout.study.throw_table:compile_throws",
    "CompiledThrows": "turnout.study.throw_table",
    # Detection
    "read_test_throws": "turnout.detection.pod.pod_table",
    "TestThrows": "turnout.detection.pod.pod_table",
    "estimate_pod": "turnout.detection.pod.estimate",
    "PodModel": "turnout.detection.pod.pod_result",
    "Pod": "turnout.detection.pod.pod_result",
    "pod_dataset": "turnout.detection.pod.pod_result",
    # Figures
    "figures": "turnout.figures",
    "detection": "turnout.detection",
    # Errors
    "TurnoutError": "turnout.core.errors",
    "FileError": "turnout.core.errors",
    "PanelError": "turnout.core.errors",
    "MachineError": "turnout.core.errors",
    "MeasurementError": "turnout.core.errors",
    "StudyError": "turnout.core.errors",
    "MechanicsError": "turnout.core.errors",
    "SolverError": "turnout.core.errors",
    "NotConverged": "turnout.solver.outcome",
    "ResponseError": "turnout.core.errors",
    "__version__": "turnout.core.version:VERSION",
}
"""Every public name and where it is defined; `__all__`, the loader and the stub follow from it."""

# What is defined there neither takes nor returns datasets, so xarray need not be loaded for it.
_WITHOUT_DATASETS = (
    *("turnout.core", "turnout.panel", "turnout.beam", "turnout.solver", "turnout.throw.save"),
    *("turnout.metric.stability",),
    *("turnout.calibration.load_study", "turnout.detection"),
)


def _register_accessor(module: str) -> None:
    """Give datasets their ``.turnout`` before a function that takes or returns them is used."""
    if not module.startswith(_WITHOUT_DATASETS):
        import turnout.api.accessor  # noqa: F401 - loading it registers


__all__ = sorted(NAMES)  # noqa: PLE0605 - follows from the table
__getattr__ = loader("turnout", NAMES, before=_register_accessor)


def __dir__() -> list[str]:
    return list(__all__)


if "xarray" in sys.modules:
    _register_accessor("xarray")
