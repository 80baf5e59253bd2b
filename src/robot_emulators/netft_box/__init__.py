"""An ATI Net F/T box (Net Box, Ethernet Axia): RDT over UDP, set-up over HTTP. ATI 9620-05, -C.
Free: the inside (tests/emulators/test_netft_box.py). Others rely on: names of settings and faults
(docs/how-to/hardware.md), `Box` and `BoxSettings` (ur). Never: a codec of wrenchbed's transducer;
an answer to requests of foreign web pages (``pages.is_ours``). Read first: box.py."""
