"""Entry point of the zipapp on the VPN server: it serves requests until its input ends."""

from __future__ import annotations

import fcntl
import os
import sys

from atlantis.module_utils.vpn_serve import main  # type: ignore[import-not-found]  # where this runs, it is there

if __name__ == "__main__":
    # As long as it runs, no newer tool removes this one.
    fcntl.flock(os.open(sys.argv[0], os.O_RDONLY), fcntl.LOCK_SH)
    main()
