"""The machinery of an ATI Net F/T box (Net Box or Ethernet Axia): RDT over UDP, set-up over HTTP.
Imports: base, plant, errors. Sources: ATI 9620-05 (RDT, status, CGI, XML), 9620-05-C (Axia).
Never: a codec of wrenchbed's transducer; both sides are written from the manual.
Read first: box.py, which the UR5's emulator uses too.
"""
