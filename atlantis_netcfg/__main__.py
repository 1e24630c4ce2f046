"""`python -m atlantis_netcfg`: what the launcher runs."""

from __future__ import annotations

import sys

from atlantis_netcfg.cli import main

if __name__ == "__main__":
    sys.exit(main())
