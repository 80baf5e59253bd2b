"""wrenchbed: a testbed for robots that carry a six-axis force/torque sensor.

The names below are the public ones; each is imported on first use.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wrenchbed.calibration import Options, calibrate
    from wrenchbed.campaign import record
    from wrenchbed.column_map import read as read_map
    from wrenchbed.drivers.sim import Options as SimOptions
    from wrenchbed.drivers.sim import SimDriver
    from wrenchbed.errors import WrenchbedError
    from wrenchbed.exporting import export
    from wrenchbed.fit import Fit
    from wrenchbed.importing import import_files
    from wrenchbed.mixing import Mix, reach
    from wrenchbed.model import Model
    from wrenchbed.plan import Plan
    from wrenchbed.planning import informative, multisine, poses
    from wrenchbed.playback import simulate
    from wrenchbed.points import read as read_points
    from wrenchbed.recording import Recording
    from wrenchbed.registry import load, names
    from wrenchbed.simulation import Simulation
    from wrenchbed.touches import Touches
    from wrenchbed.twin import Twin

    __version__: str

_HOME = {
    "Fit": ("fit", "Fit"),
    "Mix": ("mixing", "Mix"),
    "Model": ("model", "Model"),
    "Options": ("calibration", "Options"),
    "Plan": ("plan", "Plan"),
    "Recording": ("recording", "Recording"),
    "SimDriver": ("drivers.sim", "SimDriver"),
    "SimOptions": ("drivers.sim", "Options"),
    "Simulation": ("simulation", "Simulation"),
    "Touches": ("touches", "Touches"),
    "Twin": ("twin", "Twin"),
    "WrenchbedError": ("errors", "WrenchbedError"),
    "calibrate": ("calibration", "calibrate"),
    "export": ("exporting", "export"),
    "import_files": ("importing", "import_files"),
    "informative": ("planning", "informative"),
    "load": ("registry", "load"),
    "multisine": ("planning", "multisine"),
    "names": ("registry", "names"),
    "poses": ("planning", "poses"),
    "reach": ("mixing", "reach"),
    "read_map": ("column_map", "read"),
    "read_points": ("points", "read"),
    "record": ("campaign", "record"),
    "simulate": ("playback", "simulate"),
}

__all__ = [
    "Fit",
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
    import_module("wrenchbed.envs")
