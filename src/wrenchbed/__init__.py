"""wrenchbed: a testbed for robots that carry a six-axis force/torque sensor.

Every verb of the command line is a function here. A name is imported on first use; the imports for
type checkers say from where: a public name is imported as itself, or with ``_`` before it where it
has another name there.
"""

import sys
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrenchbed.benchmark.sealed.make import Family as Family
    from wrenchbed.benchmark.sealed.make import make as _blind_make
    from wrenchbed.benchmark.sealed.run import Entrant as Entrant
    from wrenchbed.benchmark.sealed.run import run as _blind_run
    from wrenchbed.benchmark.sealed.score import score as _blind_score
    from wrenchbed.calibration.calibrate import CalibrationOptions as _Options
    from wrenchbed.calibration.calibrate import calibrate as calibrate
    from wrenchbed.calibration.fit import Fit as Fit
    from wrenchbed.calibration.learn_sensor import LearnedSensor as LearnedSensor
    from wrenchbed.calibration.learn_sensor import learn_sensor as learn_sensor
    from wrenchbed.calibration.touch_points import Touches as Touches
    from wrenchbed.calibration.tracker import calibrate_tracker as calibrate_tracker
    from wrenchbed.calibration.tracker_result import TrackerFit as TrackerFit
    from wrenchbed.campaigns.monte_carlo import Fleet as Fleet
    from wrenchbed.campaigns.monte_carlo import campaign as campaign
    from wrenchbed.campaigns.run import record as record
    from wrenchbed.data.column_map import read as _read_map
    from wrenchbed.data.guess.guess import guess as _guess_map
    from wrenchbed.data.guess.user_facts import Stated as Stated
    from wrenchbed.data.import_files import import_files as import_files
    from wrenchbed.data.lerobot import import_lerobot as import_lerobot
    from wrenchbed.data.lerobot import is_lerobot as is_lerobot
    from wrenchbed.data.lerobot import write_lerobot as write_lerobot
    from wrenchbed.data.plan import Plan as Plan
    from wrenchbed.data.plan import read as _read_points
    from wrenchbed.data.recording import Recording as Recording
    from wrenchbed.data.rosbag_and_mcap import write_mcap as write_mcap
    from wrenchbed.diagnosis.diagnose import Findings as Findings
    from wrenchbed.diagnosis.diagnose import diagnose as diagnose
    from wrenchbed.diagnosis.next.dry_run import dry_run as dry_run
    from wrenchbed.diagnosis.next.excitation_trajectory import excite as excite
    from wrenchbed.diagnosis.several import diagnose_several as diagnose_several
    from wrenchbed.drives.effort_fit import DriveFit as DriveFit
    from wrenchbed.drives.identify import calibrate_efforts as calibrate_efforts
    from wrenchbed.drives.servo import calibrate_servos as calibrate_servos
    from wrenchbed.errors import WrenchbedError as WrenchbedError
    from wrenchbed.exports.base import ExportOptions as ExportOptions
    from wrenchbed.exports.base import export_to as export_to
    from wrenchbed.exports.load_numbers import LoadNumbers as LoadNumbers
    from wrenchbed.exports.load_numbers import calibrated_twin as calibrated_twin
    from wrenchbed.exports.load_numbers import load_numbers as load_numbers
    from wrenchbed.hardware.drivers.sim import SimDriver as SimDriver
    from wrenchbed.hardware.drivers.sim import SimOptions as SimOptions
    from wrenchbed.monitoring.check import Judgement as Judgement
    from wrenchbed.monitoring.check import check as check
    from wrenchbed.monitoring.check import plan_of as _check_plan
    from wrenchbed.monitoring.compare import Comparison as Comparison
    from wrenchbed.monitoring.compare import compare as compare
    from wrenchbed.monitoring.compensation import Compensator as Compensator
    from wrenchbed.monitoring.live import live as live
    from wrenchbed.planning.accuracy_plan import Mix as Mix
    from wrenchbed.planning.accuracy_plan import reach as reach
    from wrenchbed.planning.choose import for_tracker as for_tracker
    from wrenchbed.planning.choose import informative as informative
    from wrenchbed.planning.choose import multisine as multisine
    from wrenchbed.planning.choose import poses as poses
    from wrenchbed.plant.serving import EmulatorOptions as EmulatorOptions
    from wrenchbed.plant.serving import serve as serve
    from wrenchbed.registry import descriptions as descriptions
    from wrenchbed.registry import load as load
    from wrenchbed.registry import names as names
    from wrenchbed.reports.recording_page import report as report
    from wrenchbed.robots.base import Robot as Robot
    from wrenchbed.robots.described import describe as _describe_robot
    from wrenchbed.simulation.closed_form import Model as Model
    from wrenchbed.simulation.mujoco_wrench import Simulation as Simulation
    from wrenchbed.studies import run as _study
    from wrenchbed.twin.export import export as export
    from wrenchbed.twin.replay import simulate as simulate
    from wrenchbed.twin.servos import export_servos as export_servos
    from wrenchbed.twin.servos import is_of_servos as is_of_servos
    from wrenchbed.twin.twin import Twin as Twin
    from wrenchbed.viewer.rerun_window import view as view

    Options = _Options
    blind_make = _blind_make
    blind_run = _blind_run
    blind_score = _blind_score
    read_map = _read_map
    guess_map = _guess_map
    read_points = _read_points
    check_plan = _check_plan
    describe_robot = _describe_robot
    study = _study
    __version__: str


@cache
def _homes() -> dict[str, tuple[str, str]]:
    """Module of each public name, and its name there, from the imports at the top of this file."""
    import ast  # slow to load
    from pathlib import Path

    tree = ast.parse(Path(__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    return {
        str(name.asname).removeprefix("_"): (str(node.module), name.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    }


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # slow to load

        return version("wrenchbed")
    if name == "__all__":
        return __dir__()
    if name not in _homes():
        raise AttributeError(f"module 'wrenchbed' has no attribute {name!r}")
    module, attribute = _homes()[name]
    return getattr(import_module(module), attribute)


def __dir__() -> list[str]:
    return sorted([*_homes(), "__version__"])


if "gymnasium" in sys.modules:  # a program that has imported it will look for the environments
    import_module("wrenchbed.environments")
