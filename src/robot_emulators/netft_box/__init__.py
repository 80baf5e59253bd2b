"""An ATI Net F/T box (Net Box, Ethernet Axia): RDT over UDP, set-up over HTTP. ATI 9620-05, -C.
Free: the inside (tests/emulators/test_netft_box.py). Others rely on: settings, faults, `Box` (ur).
Never: a codec of wrenchbed's transducer; a reply to a page elsewhere (``pages.is_ours``).
Read first: box.py.
"""
