"""ATI Net F/T: a Net Box or Ethernet Axia that streams RDT over UDP and shows its set-up by HTTP.

Sources: ATI 9620-05 Net F/T manual (RDT, status codes, CGI variables, netftapi2.xml) and
ATI 9620-05-C Ethernet Axia (its status codes).
"""

from wrenchbed.emulators.netft_box.box import Box
from wrenchbed.emulators.netft_box.sensing import BoxSettings

__all__ = ["Box", "BoxSettings"]
