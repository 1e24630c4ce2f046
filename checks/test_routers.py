"""The routers of the site are as in the inventory; differences are named as in `provision report drift`."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.runs.report.drift import drift_lines

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host

PROVISION = str(Path(sys.executable).with_name("provision"))


def test_a_router_holds_what_is_declared(router: Host, inventory: Path) -> None:
    requested = ["report", "drift", f"site={router.site}", f"device={router.name}", f"inventory={inventory}", "--json"]
    done = subprocess.run([PROVISION, *requested], capture_output=True, text=True, check=False)
    result = json.loads(done.stdout)
    assert not result["errors"], result["errors"]
    found = result["devices"][router.name]
    assert done.returncode == ExitCode.DONE, f"{router.name}: {found['message']}\n{drift_lines(found)}"
