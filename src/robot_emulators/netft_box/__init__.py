"""The machinery of an ATI Net F/T box (Net Box or Ethernet Axia): RDT over UDP, set-up over HTTP.
Imports: emulators/base, errors. Sources: ATI 9620-05 (RDT, status, CGI, XML), 9620-05-C (Axia).
Read first: box.py. The emulator of a sensor alone is emulators/netft.py; the UR5's uses Box too.
"""

from robot_emulators.netft_box.box import Box
from robot_emulators.netft_box.sensing import BoxSettings

__all__ = ["Box", "BoxSettings"]
