"""``python -m wrenchbed`` is the command line."""

import sys

from wrenchbed.cli import main

sys.exit(main())
