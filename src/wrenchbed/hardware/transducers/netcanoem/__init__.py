"""An ATI Mini40, or any other ATI sensor with analogue gauges, on a NETCANOEM board over CAN."""

from wrenchbed.hardware.transducers.netcanoem.transducer import (
    NetcanoemOptions,
    NetcanoemTransducer,
)

TRANSDUCER = NetcanoemTransducer

__all__ = ["TRANSDUCER", "NetcanoemOptions", "NetcanoemTransducer"]
