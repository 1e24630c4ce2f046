"""A new kind of bearer is a name and a row in one file: validated, planned, drawn, checked, tuned and priced."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[3]
CARRIED = ("atlantis_netcfg", "inventory", "playbooks", "roles", "templates", "ansible.cfg", "pyproject.toml")
ADDED = {
    '    ETHERNET = "ethernet"\n': '    ETHERNET = "ethernet"\n    LEO = "leo"\n',
    "    BearerKind.ETHERNET: BearerTraits(": (
        "    BearerKind.LEO: BearerTraits(Column.LTE, Pace.MOBILE),\n    BearerKind.ETHERNET: BearerTraits("
    ),
}
"""What a developer writes in declaration/model/site.py: before, after."""
SCRIPT = """
import json
from pathlib import Path
from atlantis_netcfg.bearers.cost import preview
from atlantis_netcfg.checklist.plan import plan
from atlantis_netcfg.checklist.topology import drawing
from atlantis_netcfg.declaration.loading import load
from atlantis_netcfg.gateway.dds import profile_views
from atlantis_netcfg.operations.costs import link_of
from atlantis_netcfg.vpn.client import site_link

declaration = load(Path("inventory"))
checklist = plan(declaration, "scc")
(drawn,) = (link for link in drawing(declaration, checklist).links if link.kind == "4g")
(profile,) = profile_views(declaration, declaration.hosts["scc-control"])
print(json.dumps({
    "items": [entry.item.title for entry in checklist.entries if entry.item.endpoint == "4g"],
    "drawn": [drawn.label, len(drawn.items)],
    "announced": profile.tuning.announce_s,
    "tunnel": site_link(declaration, "scc").value,
    "price": preview(1_000_000, 1.0, link_of(declaration, "scc", "uplink"), at_most=True).words,
}))
"""


def run(folder: Path, *words: str, code: int = 0) -> str:
    done = subprocess.run(
        [sys.executable, "-P", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder), "ATLANTIS_STATE": str(folder / "state")},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_kind_of_bearer_is_a_row_of_one_table(tmp_path: Path) -> None:
    for name in CARRIED:
        source = CHECKOUT / name
        if source.is_dir():
            shutil.copytree(source, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, tmp_path)
    model = tmp_path / "atlantis_netcfg/declaration/model/site.py"
    text = model.read_text(encoding="utf-8")
    for before, after in ADDED.items():
        assert text.count(before) == 1
        text = text.replace(before, after)
    model.write_text(text, encoding="utf-8")
    site = tmp_path / "inventory/group_vars/scc.yml"
    declared = site.read_text(encoding="utf-8")
    billing = "      metered: true\n      billing: {price_per_mb: 2.0}\n"
    site.write_text(
        declared.replace("      kind: ethernet\n      metered: false\n", "      kind: leo\n" + billing),
        encoding="utf-8",
    )

    run(tmp_path, "-m", "atlantis_netcfg", "validate")
    planned = run(tmp_path, "-m", "atlantis_netcfg", "site=scc", "--rehearse", "--plan", code=2)
    links = json.loads(run(tmp_path, "-m", "atlantis_netcfg", "links", "site=scc", "--rehearse", "--json"))
    seen = json.loads(run(tmp_path, "-c", SCRIPT))
    assert "+ set name=scc-router" in planned
    uplink = links["bearers"]["uplink"]
    assert (uplink["kind"], uplink["state"], uplink["metered"]) == ("leo", "up", True)
    assert seen == {
        "items": ["4G of Control centre is registered, has an address, and carries traffic"],
        "drawn": ["4G", 1],
        "announced": 20,  # the pace of the slowest path: from the vessel's satellite
        "tunnel": "4g",
        "price": "over uplink of scc, which is paid by the byte: up to 1.0 MB, 2.00 EUR",
    }
