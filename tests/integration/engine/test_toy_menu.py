"""A new menu of RouterOS is a row of the engine's schema and one of the emulated router: shown with a toy."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[3]
ROWS = {
    "routeros/menus/_system.py": """
MENUS += (
    Menu(
        "/system/watchdog",
        Shape.SINGLETON,
        Layer.FOUNDATION,
        fields=(boolean("watchdog-timer", "yes"), text("watch-address", "none"), number("ping-start-after-boot", "5")),
    ),
)
""",
    "emulator/routeros/menus/_system.py": """
MENUS += (of_schema("/system/watchdog", noun="watchdog", kinds={"watch-address": Address(words=("none",))}),)
""",
}
"""What a developer adds, by file."""
SCRIPT = """
import json, sys
from pathlib import Path
from engine_bench import Bench, on

async def act(bench):
    results = [await bench.converge() for _ in range(2)]
    refused, _ = await bench.router.console(["/system/watchdog/set", "=watch-address=nowhere"])
    ended = [[result.status.value, result.planned] for result in results]
    print(json.dumps([ended, refused.words, bench.export().partition("/system watchdog\\n")[2].splitlines()[0]]))

on(Bench(Path(sys.argv[1]), text="/system watchdog\\nset watchdog-timer=no\\n"), act)
"""


@pytest.mark.slow
def test_a_menu_is_a_row_of_the_schema_and_one_of_the_emulated_router(tmp_path: Path) -> None:
    shutil.copytree(
        CHECKOUT / "atlantis_netcfg", tmp_path / "atlantis_netcfg", ignore=shutil.ignore_patterns("__pycache__")
    )
    for name, row in ROWS.items():
        with (tmp_path / "atlantis_netcfg" / name).open("a", encoding="utf-8") as file:
            file.write(row)
    done = subprocess.run(
        [sys.executable, "-P", "-c", SCRIPT, tmp_path / "bench"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join((str(tmp_path), str(Path(__file__).parent)))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    ended, refused, exported = json.loads(done.stdout)
    assert ended == [["changed", 1], ["unchanged", 0]]
    assert refused[-1] == "=message=invalid value for argument watch-address"
    assert exported == "set watchdog-timer=no"
