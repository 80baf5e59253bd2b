"""Transducer for sensors of Bota Systems (Rokubi, SensONE and kin) with their serial interface.

May import: transducer base, ``serial_line``, device clock, registry, errors; no other transducer.
Read first: ``transducer.py``, then ``frames.py`` (the stream) and ``console.py`` (commands).
"""

from wrenchbed.hardware.transducers.bota.transducer import BotaOptions, BotaTransducer

TRANSDUCER = BotaTransducer

__all__ = ["TRANSDUCER", "BotaOptions", "BotaTransducer"]
