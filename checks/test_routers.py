"""The routers of the site are what the declaration says: an empty plan, made from what each of them holds now."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import ExitCode

if TYPE_CHECKING:
    from atlantis_netcfg.site import Host

PROVISION = str(Path(sys.executable).with_name("provision"))


def test_a_router_holds_what_is_declared(router: Host, inventory: Path) -> None:
    asked = [f"site={router.site}", f"only={router.name}", f"inventory={inventory}", "--plan", "--json"]
    done = subprocess.run([PROVISION, *asked], capture_output=True, text=True, check=False)
    told = json.loads(done.stdout)
    assert not told["errors"], told["errors"]
    differs = told["devices"][router.name]["diff"]
    assert done.returncode == ExitCode.DONE, f"{router.name} differs from the declaration:\n{differs}"
