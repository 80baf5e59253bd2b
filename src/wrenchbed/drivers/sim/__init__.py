"""The simulated robot: MuJoCo moves it in simulated time, its sensor adds realistic noise."""

from wrenchbed.drivers.sim.driver import Options, SimDriver

DRIVER = SimDriver

__all__ = ["DRIVER", "Options", "SimDriver"]
