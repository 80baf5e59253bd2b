"""An ATI Net F/T box (Net Box, Ethernet Axia): RDT over UDP, set-up over HTTP. ATI 9620-05, -C.
Free: the code inside functions (tests/emulators/test_netft_box.py). Not free: names of settings and
faults (change docs/how-to/hardware.md too), `Box` and `BoxSettings` (ur/server.py uses them), names
and layout of pages and records (the manual's). Never: a codec of wrenchbed's transducer; an answer
to requests of foreign web pages (``pages.is_ours``). Read first: box.py."""
