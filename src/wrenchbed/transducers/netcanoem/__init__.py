"""An ATI Mini40, or any other ATI sensor with analogue gauges, on a NETCANOEM board over CAN."""

from wrenchbed.transducers.netcanoem.transducer import NetcanoemTransducer, Options

TRANSDUCER = NetcanoemTransducer

__all__ = ["TRANSDUCER", "NetcanoemTransducer", "Options"]
