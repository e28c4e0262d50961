"""`python -m vehicle_iface` is the `vehicle-iface` command."""

import sys

from vehicle_iface.cli import main

sys.exit(main())
