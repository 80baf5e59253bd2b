"""wrenchbed: a testbed for robots that carry a six-axis force/torque sensor.

Every verb of the command line is a function here. A name is imported on first use; the imports for
type checkers say from where.
Used by: the command line, and everybody who writes ``import wrenchbed``.
"""

import sys
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrenchbed.benchmark.sealed.make import Family
    from wrenchbed.benchmark.sealed.make import make as blind_make
    from wrenchbed.benchmark.sealed.run import Entrant
    from wrenchbed.benchmark.sealed.run import run as blind_run
    from wrenchbed.benchmark.sealed.score import score as blind_score
    from wrenchbed.calibration.calibrate import CalibrationOptions as Options
    from wrenchbed.calibration.calibrate import calibrate
    from wrenchbed.calibration.fit import Fit
    from wrenchbed.calibration.learn_sensor import LearnedSensor, learn_sensor
    from wrenchbed.calibration.touches import Touches
    from wrenchbed.calibration.tracker import calibrate_tracker
    from wrenchbed.calibration.tracker_fit import TrackerFit
    from wrenchbed.campaigns.recording.run import record
    from wrenchbed.campaigns.settings import Fleet
    from wrenchbed.campaigns.simulated_robots import campaign
    from wrenchbed.data.column_map import read as read_map
    from wrenchbed.data.guess.guess import guess as guess_map
    from wrenchbed.data.guess.stated import Stated
    from wrenchbed.data.import_files import import_files
    from wrenchbed.data.lerobot import import_lerobot, is_lerobot
    from wrenchbed.data.logs import write_mcap
    from wrenchbed.data.plan import Plan
    from wrenchbed.data.plan import read as read_points
    from wrenchbed.data.recording import Recording
    from wrenchbed.diagnosis.diagnose import Findings, diagnose
    from wrenchbed.diagnosis.next.dry_run import dry_run
    from wrenchbed.diagnosis.next.excitation import excite
    from wrenchbed.diagnosis.several import diagnose_several
    from wrenchbed.drives.fit import DriveFit
    from wrenchbed.drives.identify import calibrate_efforts
    from wrenchbed.drives.servo import calibrate_servos
    from wrenchbed.errors import WrenchbedError
    from wrenchbed.exports.base import ExportOptions, export_to
    from wrenchbed.exports.load_numbers import LoadNumbers, calibrated_twin, load_numbers
    from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions
    from wrenchbed.monitoring.check import Judgement, check
    from wrenchbed.monitoring.check import plan_of as check_plan
    from wrenchbed.monitoring.compare import Comparison, compare
    from wrenchbed.monitoring.compensation import Compensator
    from wrenchbed.monitoring.live import live
    from wrenchbed.planning.accuracy_plan import Mix, MixOptions, reach
    from wrenchbed.planning.choose import for_tracker, informative, multisine, poses
    from wrenchbed.plant.serving import EmulatorOptions, serve
    from wrenchbed.registry import descriptions, load, names
    from wrenchbed.reports.recording_page import report
    from wrenchbed.robots.base import Robot
    from wrenchbed.robots.described import describe as describe_robot
    from wrenchbed.simulation.closed_form import Model
    from wrenchbed.simulation.simulation import Simulation
    from wrenchbed.studies import run as study
    from wrenchbed.twin.export import export
    from wrenchbed.twin.replay import simulate
    from wrenchbed.twin.servos import export_servos, is_of_servos
    from wrenchbed.twin.twin import Twin
    from wrenchbed.viewer.show import view

    __version__: str

__all__ = [
    "Comparison",
    "Compensator",
    "DriveFit",
    "EmulatorOptions",
    "Entrant",
    "ExportOptions",
    "Family",
    "Findings",
    "Fit",
    "Fleet",
    "Judgement",
    "LearnedSensor",
    "LoadNumbers",
    "Mix",
    "MixOptions",
    "Model",
    "Options",
    "Plan",
    "Recording",
    "Robot",
    "SimDriver",
    "SimOptions",
    "Simulation",
    "Stated",
    "Touches",
    "TrackerFit",
    "Twin",
    "WrenchbedError",
    "__version__",
    "blind_make",
    "blind_run",
    "blind_score",
    "calibrate",
    "calibrate_efforts",
    "calibrate_servos",
    "calibrate_tracker",
    "calibrated_twin",
    "campaign",
    "check",
    "check_plan",
    "compare",
    "describe_robot",
    "descriptions",
    "diagnose",
    "diagnose_several",
    "dry_run",
    "excite",
    "export",
    "export_servos",
    "export_to",
    "for_tracker",
    "guess_map",
    "import_files",
    "import_lerobot",
    "informative",
    "is_lerobot",
    "is_of_servos",
    "learn_sensor",
    "live",
    "load",
    "load_numbers",
    "multisine",
    "names",
    "poses",
    "reach",
    "read_map",
    "read_points",
    "record",
    "report",
    "serve",
    "simulate",
    "study",
    "view",
    "write_mcap",
]


@cache
def _homes() -> dict[str, tuple[str, str]]:
    """Module of each public name, and its name there, from the imports at the top of this file."""
    import ast  # slow to load
    from pathlib import Path

    tree = ast.parse(Path(__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    imports = (node for node in block.body if isinstance(node, ast.ImportFrom))
    return {a.asname or a.name: (str(i.module), a.name) for i in imports for a in i.names}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # slow to load

        return version("wrenchbed")
    if name.startswith("_") or name not in __all__:
        raise AttributeError(f"module 'wrenchbed' has no attribute {name!r}")
    module, attribute = _homes()[name]
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return list(__all__)


if "gymnasium" in sys.modules:  # a program that has imported it will look for the environments
    import_module("wrenchbed.environments")
