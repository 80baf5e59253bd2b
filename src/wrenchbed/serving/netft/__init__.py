"""ATI Net F/T: a Net Box or Ethernet Axia that streams RDT over UDP and shows its set-up by HTTP.

Sources: ATI 9620-05 Net F/T manual (RDT, status codes, CGI variables, netftapi2.xml) and
ATI 9620-05-C Ethernet Axia (its status codes).
"""

from wrenchbed.serving.netft.box import Box
from wrenchbed.serving.netft.settings import HELP, Settings

__all__ = ["HELP", "Box", "Settings"]
