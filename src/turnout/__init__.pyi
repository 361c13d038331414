"""Written by `python -m turnout.api.stub` from the table in __init__.py."""

from turnout import detection as detection
from turnout import figures as figures
from turnout.api.calibration import CalibrationResult as CalibrationResult
from turnout.api.calibration import calibrate as calibrate
from turnout.api.calibration import load_calibration as load_calibration
from turnout.api.campaign import Campaign as Campaign
from turnout.api.campaign import build_campaign as build_campaign
from turnout.api.campaign import load_campaign as load_campaign
from turnout.api.machine import fit_machines as fit_machines
from turnout.api.machine import fit_three_phase as fit_three_phase
from turnout.api.recording import import_recording as import_recording
from turnout.api.sweep import Sweep as Sweep
from turnout.api.sweep import open_sweep as open_sweep
from turnout.api.sweep import run_sweep as run_sweep
from turnout.api.validation import Validation as Validation
from turnout.api.validation import validate as validate
from turnout.beam.outline import make_outline as make_outline
from turnout.beam.section_analysis import analyse_outline as analyse_outline
from turnout.calibration.load_study import load_panel_or_case as load_panel
from turnout.calibration.load_study import load_study as load_study
from turnout.calibration.machine_estimates.machine_fit import MachineFit as MachineFit
from turnout.calibration.machine_estimates.three_phase import ThreePhaseFit as ThreePhaseFit
from turnout.core.errors import FileError as FileError
from turnout.core.errors import MachineError as MachineError
from turnout.core.errors import MeasurementError as MeasurementError
from turnout.core.errors import MechanicsError as MechanicsError
from turnout.core.errors import PanelError as PanelError
from turnout.core.errors import ResponseError as ResponseError
from turnout.core.errors import SolverError as SolverError
from turnout.core.errors import StudyError as StudyError
from turnout.core.errors import TurnoutError as TurnoutError
from turnout.core.scheme import Scheme as Scheme
from turnout.core.version import VERSION as __version__
from turnout.detection.pod.estimate import estimate_pod as estimate_pod
from turnout.detection.pod.pod_result import Pod as Pod
from turnout.detection.pod.pod_result import PodModel as PodModel
from turnout.detection.pod.pod_result import pod_dataset as pod_dataset
from turnout.detection.pod.pod_table import TestThrows as TestThrows
from turnout.detection.pod.pod_table import read_test_throws as read_test_throws
from turnout.machine.machine_file import LoadedMachines as LoadedMachines
from turnout.machine.machine_file import load_machines as load_machines
from turnout.measurement.chain.monitoring import Monitoring as Monitoring
from turnout.measurement.chain.monitoring import monitored as monitored
from turnout.measurement.formats.file_format import read_recording as read_recording
from turnout.measurement.formats.history import read_history as read_history
from turnout.metric.channel_features import filtered as filtered
from turnout.metric.features import features as features
from turnout.metric.modes import modes as modes
from turnout.metric.stability import friction_stability as friction_stability
from turnout.panel.foreign_object import ForeignObject as ForeignObject
from turnout.panel.load import LoadedPanel as LoadedPanel
from turnout.panel.load import library_names as panel_names
from turnout.solver.outcome import NotConverged as NotConverged
from turnout.study.throw_table import CompiledThrows as CompiledThrows
from turnout.study.throw_table import compile_throws as compile
from turnout.throw.drift import Drift as Drift
from turnout.throw.machine import MachineThrow as MachineThrow
from turnout.throw.machine import machine_dataset as machine_dataset
from turnout.throw.machine import throw_one_mass as throw_one_mass
from turnout.throw.save import Save as Save
from turnout.throw.sequence import simulate_sequence as simulate_sequence
from turnout.throw.simulate import simulate as simulate
from turnout.throw.store import open_response as open_response
from turnout.throw.store import save_response as save_response
from turnout.throw.wheel import gauge_under_wheel as gauge_under_wheel

__all__ = [
    "CalibrationResult",
    "Campaign",
    "CompiledThrows",
    "Drift",
    "FileError",
    "ForeignObject",
    "LoadedMachines",
    "LoadedPanel",
    "MachineError",
    "MachineFit",
    "MachineThrow",
    "MeasurementError",
    "MechanicsError",
    "Monitoring",
    "NotConverged",
    "PanelError",
    "Pod",
    "PodModel",
    "ResponseError",
    "Save",
    "Scheme",
    "SolverError",
    "StudyError",
    "Sweep",
    "TestThrows",
    "ThreePhaseFit",
    "TurnoutError",
    "Validation",
    "__version__",
    "analyse_outline",
    "build_campaign",
    "calibrate",
    "compile",
    "detection",
    "estimate_pod",
    "features",
    "figures",
    "filtered",
    "fit_machines",
    "fit_three_phase",
    "friction_stability",
    "gauge_under_wheel",
    "import_recording",
    "load_calibration",
    "load_campaign",
    "load_machines",
    "load_panel",
    "load_study",
    "machine_dataset",
    "make_outline",
    "modes",
    "monitored",
    "open_response",
    "open_sweep",
    "panel_names",
    "pod_dataset",
    "read_history",
    "read_recording",
    "read_test_throws",
    "run_sweep",
    "save_response",
    "simulate",
    "simulate_sequence",
    "throw_one_mass",
    "validate",
]
