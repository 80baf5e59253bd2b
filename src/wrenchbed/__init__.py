"""wrenchbed: a testbed for robots that carry a six-axis force/torque sensor.

The names below are the public ones; each is imported on first use.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrenchbed.calibration.calibrate import CalibrationOptions as Options
    from wrenchbed.calibration.calibrate import calibrate
    from wrenchbed.calibration.fit import Fit
    from wrenchbed.calibration.touches import Touches
    from wrenchbed.campaigns.campaign import campaign
    from wrenchbed.campaigns.recording.run import record
    from wrenchbed.campaigns.setting import Fleet
    from wrenchbed.data.column_map import read as read_map
    from wrenchbed.data.import_files import import_files
    from wrenchbed.data.plan import Plan
    from wrenchbed.data.plan import read as read_points
    from wrenchbed.data.recording import Recording
    from wrenchbed.errors import WrenchbedError
    from wrenchbed.hardware.drivers.sim import SimDriver, SimOptions
    from wrenchbed.planning.accuracy_plan import Mix, reach
    from wrenchbed.planning.choose import informative, multisine, poses
    from wrenchbed.registry import load, names
    from wrenchbed.simulation.closed_form import Model
    from wrenchbed.simulation.simulation import Simulation
    from wrenchbed.twin.export import export
    from wrenchbed.twin.replay import simulate
    from wrenchbed.twin.twin import Twin

    __version__: str

_HOME = {
    "Fit": ("calibration.fit", "Fit"),
    "Fleet": ("campaigns.setting", "Fleet"),
    "Mix": ("planning.accuracy_plan", "Mix"),
    "Model": ("simulation.closed_form", "Model"),
    "Options": ("calibration.calibrate", "CalibrationOptions"),
    "Plan": ("data.plan", "Plan"),
    "Recording": ("data.recording", "Recording"),
    "SimDriver": ("hardware.drivers.sim", "SimDriver"),
    "SimOptions": ("hardware.drivers.sim", "SimOptions"),
    "Simulation": ("simulation.simulation", "Simulation"),
    "Touches": ("calibration.touches", "Touches"),
    "Twin": ("twin.twin", "Twin"),
    "WrenchbedError": ("errors", "WrenchbedError"),
    "calibrate": ("calibration.calibrate", "calibrate"),
    "campaign": ("campaigns.campaign", "campaign"),
    "export": ("twin.export", "export"),
    "import_files": ("data.import_files", "import_files"),
    "informative": ("planning.choose", "informative"),
    "load": ("registry", "load"),
    "multisine": ("planning.choose", "multisine"),
    "names": ("registry", "names"),
    "poses": ("planning.choose", "poses"),
    "reach": ("planning.accuracy_plan", "reach"),
    "read_map": ("data.column_map", "read"),
    "read_points": ("data.plan", "read"),
    "record": ("campaigns.recording.run", "record"),
    "simulate": ("twin.replay", "simulate"),
}

__all__ = [
    "Fit",
    "Fleet",
    "Mix",
    "Model",
    "Options",
    "Plan",
    "Recording",
    "SimDriver",
    "SimOptions",
    "Simulation",
    "Touches",
    "Twin",
    "WrenchbedError",
    "__version__",
    "calibrate",
    "campaign",
    "export",
    "import_files",
    "informative",
    "load",
    "multisine",
    "names",
    "poses",
    "reach",
    "read_map",
    "read_points",
    "record",
    "simulate",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version  # slow to load

        return version("wrenchbed")
    if name not in _HOME:
        raise AttributeError(f"module 'wrenchbed' has no attribute {name!r}")
    module, attribute = _HOME[name]
    return getattr(import_module(f"wrenchbed.{module}"), attribute)


if "gymnasium" in sys.modules:  # who has imported it will ask it for our environments
    import_module("wrenchbed.environments")
