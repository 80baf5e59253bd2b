"""What the driver must be told, checked before anything is sent."""

from dataclasses import dataclass
from math import isfinite, tau
from numbers import Integral

from wrenchbed import registry
from wrenchbed.drivers.base import Limits
from wrenchbed.drivers.can import ids, load
from wrenchbed.errors import ParameterError

HEARTBEAT_S = 0.1
ROBOT = "medrue"
_DRIVES = 6
_PER_TURN = (1 << 20) / tau


@dataclass(frozen=True)
class Options:
    """Where the robot is and how it counts. MedRUE's own figures are not public: set yours.

    Attributes:
        robot: registry name; only MedRUE has these drives.
        channel: name of the bus.
        interface: of python-can; SocketCAN, or socketcand where a host is given, if empty.
        host: of a socketcand server.
        port: of a socketcand server.
        bitrate: of the bus [bit/s].
        nodes: CANopen ids of the drives, in the order of the joints.
        base: upper seven bits of the sensor board's ids. The maker's 0x20 collides with CANopen.
        slot: of the sensor's calibration on its board, 0 … 15.
        rate: of the cyclic exchange [Hz].
        counts_per_unit: of each drive per m or rad, negative where it counts the other way;
            1 µm and 2²⁰ per turn unless given.
        torque: whether drives shall tell their torque (0x6077, 0x6076).
        watchdog: after how long without targets a drive stops by itself [s].
        limits: what the robot may do; a quarter of top speed anywhere if None.
    """

    robot: str = ROBOT
    channel: str = "can0"
    interface: str = ""
    host: str = ""
    port: int = 29536
    bitrate: int = 1_000_000
    nodes: tuple[int, ...] = (1, 2, 3, 4, 5, 6)
    base: int = ids.SAFE
    slot: int = 0
    rate: float = 250.0
    counts_per_unit: tuple[float, ...] = (1e6, *[_PER_TURN] * 5)
    torque: bool = False
    watchdog: float = 0.05
    limits: Limits | None = None

    def __post_init__(self) -> None:
        if self.robot != ROBOT:
            raise ParameterError(
                f"driver 'can' moves robot {ROBOT!r} only, not {self.robot!r}: "
                + ("take driver 'rtde'" if self.robot.startswith("ur") else "take driver 'sim'")
            )
        if len(self.nodes) != _DRIVES or len(self.counts_per_unit) != _DRIVES:
            raise ParameterError("nodes and counts_per_unit: give six each, one a joint")
        self._check_counts()
        whole = (*self.nodes, self.port, self.bitrate, self.base, self.slot)
        if not all(isinstance(number, Integral) for number in whole):
            raise ParameterError("nodes, port, bitrate, base and slot: give whole numbers")
        if not 0 < self.port < 1 << 16 or not self.bitrate >= 1000:
            raise ParameterError(
                f"port {self.port} must be 1 … 65535, bitrate {self.bitrate} bit/s at least 1000"
            )
        ids.check(self.base, self.nodes)
        if not self.rate > 0.0 or self.interpolation is None:
            raise ParameterError(
                f"rate {self.rate:g} Hz: its period must be whole tenths of a millisecond up to "
                "255 ms, as 100, 125, 200, 250, 400 or 500 Hz"
            )
        if not 3.0 / self.rate <= self.watchdog <= 10.0:
            raise ParameterError(
                f"watchdog {self.watchdog:g} s must be 3 cycles ({3.0 / self.rate:g} s) … 10 s"
            )
        if self.bus_load.share > load.MOST:
            raise ParameterError(
                f"rate {self.rate:g} Hz needs up to {100 * self.bus_load.share:.0f} % of a bus of "
                f"{self.bitrate} bit/s, more than {100 * load.MOST:.0f} %: at most "
                f"{self.rate * load.MOST / self.bus_load.share:.0f} Hz, or a faster bus"
            )

    def _check_counts(self) -> None:
        if not all(isfinite(count) and count != 0.0 for count in self.counts_per_unit):
            raise ParameterError(
                "counts_per_unit: give finite numbers, none may be 0; negative turns an axis round"
            )
        joints = registry.load("robots", ROBOT).joints
        for joint, count in zip(joints, self.counts_per_unit, strict=True):
            if max(abs(joint.lower), abs(joint.upper)) * abs(count) >= 1 << 31:
                raise ParameterError(
                    f"counts_per_unit: with {count:g} a {joint.unit} the limits of {joint.name} "
                    "do not fit into a target's 32 bits"
                )

    @property
    def interpolation(self) -> tuple[int, int] | None:
        """Period of the targets for 0x60C2: a number up to 255 and a power of ten [s]."""
        for power in (-3, -4):
            ticks = 10.0**-power / self.rate
            if abs(ticks - round(ticks)) < 1e-6 and 1 <= round(ticks) <= 255:
                return round(ticks), power
        return None

    @property
    def bus_load(self) -> load.Load:
        """Modelled load of the cyclic exchange."""
        return load.modelled(_DRIVES, self.rate, self.bitrate, self.torque, HEARTBEAT_S, 1)
