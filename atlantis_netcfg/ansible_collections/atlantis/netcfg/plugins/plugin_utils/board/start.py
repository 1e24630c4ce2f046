"""Entry point of the zipapp on a gateway: `python3 -I TOOL.pyz MODULE` runs one of our modules."""

from __future__ import annotations

import fcntl
import importlib
import os
import sys


def main() -> None:
    """Run the module named by the first argument; a shared lock keeps newer versions from removing this zipapp."""
    fcntl.flock(os.open(sys.argv[0], os.O_RDONLY), fcntl.LOCK_SH)
    importlib.import_module(f"atlantis.modules.{sys.argv[1]}").main()


if __name__ == "__main__":
    main()
