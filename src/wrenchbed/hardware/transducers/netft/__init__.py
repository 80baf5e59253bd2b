"""ATI Net F/T and Ethernet Axia: RDT over UDP, scaled by what the box's own web page says.

Sources: ATI 9620-05 Net F/T manual (RDT, CGI variables, netftapi2.xml, system status codes) and
ATI 9620-05-C Ethernet Axia (its status codes).
"""

from wrenchbed.hardware.transducers.netft.transducer import NetftOptions, NetftTransducer

TRANSDUCER = NetftTransducer

__all__ = ["TRANSDUCER", "NetftOptions", "NetftTransducer"]
