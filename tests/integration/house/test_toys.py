"""How much a newcomer has to touch for a menu, a kind of bearer, a command, a probe, a site check: shown with toys.

docs/engineers/architecture.md says the same; each test adds its toy to a copy of the product and sees it work.
"""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[3]
CARRIED = ("atlantis_netcfg", "inventory", "playbooks", "roles", "templates", "ansible.cfg", "pyproject.toml")
pytestmark = pytest.mark.slow


@dataclass
class Copy:
    """A copy of the product into which somebody writes; what is compiled comes along, and is seen to be out of date."""

    folder: Path

    def __post_init__(self) -> None:
        for name in CARRIED:
            if (CHECKOUT / name).is_dir():
                being_compiled = shutil.ignore_patterns("*.pyc.*")
                shutil.copytree(CHECKOUT / name, self.folder / name, ignore=being_compiled)
            else:
                shutil.copy(CHECKOUT / name, self.folder)

    def replace(self, file: str, before: str, after: str) -> None:
        path = self.folder / file
        text = path.read_text(encoding="utf-8")
        assert text.count(before) == 1, (file, before)
        path.write_text(text.replace(before, after), encoding="utf-8")

    def append(self, file: str, text: str) -> None:
        with (self.folder / file).open("a", encoding="utf-8") as stream:
            stream.write(text)

    def run(self, *words: str, code: int = 0, path: str = "") -> str:
        done = subprocess.run(
            [sys.executable, "-P", *words],
            cwd=self.folder,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(filter(None, (str(self.folder), path))),
                "ATLANTIS_STATE": str(self.folder / "state"),
            },
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout

    def provision(self, *words: str, code: int = 0) -> str:
        return self.run("-m", "atlantis_netcfg", *words, code=code)


@pytest.fixture
def product(tmp_path: Path) -> Copy:
    return Copy(tmp_path)


CONVERGED = """
import json, sys
from pathlib import Path
from engine_bench import Bench, on

async def act(bench):
    results = [await bench.converge() for _ in range(2)]
    refused, _ = await bench.router.console(["/system/watchdog/set", "=watch-address=nowhere"])
    ended = [[result.status.value, result.planned_count] for result in results]
    print(json.dumps([ended, refused.words, bench.export().partition("/system watchdog\\n")[2].splitlines()[0]]))

on(Bench(Path("bench"), text="/system watchdog\\nset watchdog-timer=no\\n"), act)
"""


def test_new_routeros_menu_needs_one_schema_row_and_one_emulator_row(product: Copy) -> None:
    product.append(
        "atlantis_netcfg/routeros/menus/_system.py",
        """
MENUS += (
    _model.Menu(
        "/system/watchdog",
        _model.Shape.SINGLETON,
        Layer.FOUNDATION,
        fields=(
            _model.boolean("watchdog-timer", "yes"),
            _model.text("watch-address", "none"),
            _model.number("ping-start-after-boot", "5"),
        ),
    ),
)
""",
    )
    product.append(
        "atlantis_netcfg/emulator/routeros/menus/_system.py",
        """
_WATCHED = values.Address(words=("none",))
MENUS += (_model.of_schema("/system/watchdog", noun="watchdog", kinds={"watch-address": _WATCHED}),)
""",
    )
    engine = str(CHECKOUT / "tests/integration/routeros/engine")
    ended, refused, exported = json.loads(product.run("-c", CONVERGED, path=engine))
    assert ended == [["changed", 1], ["unchanged", 0]]
    assert refused[-1] == "=message=invalid value for argument watch-address"
    assert exported == "set watchdog-timer=no"


LOOKED_AT = """
import json
from pathlib import Path
from atlantis_netcfg.links.cost import preview
from atlantis_netcfg.checklist.plan import plan
from atlantis_netcfg.checklist.plan import drawing
from atlantis_netcfg.inventory.loader import load
from atlantis_netcfg.computers.dds import profile_views
from atlantis_netcfg.operations.common.site_links import link_of
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


def test_new_link_kind_needs_one_table_row(product: Copy) -> None:
    model = "atlantis_netcfg/inventory/model/site.py"
    product.replace(model, '    ETHERNET = "ethernet"\n', '    ETHERNET = "ethernet"\n    LEO = "leo"\n')
    row = "    LinkKind.ETHERNET: LinkTraits("
    product.replace(model, row, f"    LinkKind.LEO: LinkTraits(Column.LTE, Pace.MOBILE, ThresholdsName.LTE),\n{row}")
    product.replace(
        "inventory/group_vars/scc.yml",
        "      kind: ethernet\n      metered: false\n",
        "      kind: leo\n      metered: true\n      billing: {price_per_mb: 2.0}\n",
    )

    product.provision("inventory", "validate")
    assert "~ name: MikroTik → scc-router" in product.provision("plan", "site=scc", "--rehearse", code=2)
    uplink = json.loads(product.provision("links", "site=scc", "--rehearse", "--json"))["bearers"]["uplink"]
    assert (uplink["kind"], uplink["state"], uplink["metered"]) == ("leo", "up", True)
    assert json.loads(product.run("-c", LOOKED_AT)) == {
        "items": ["4G of Control centre is registered, has an address, and carries traffic"],
        "drawn": ["4G", 1],
        "announced": 20,  # the pace of the slowest path: from the vessel's satellite
        "tunnel": "4g",
        "price": "over metered link uplink of scc: up to 1.0 MB, 2.00 EUR",
    }


COMMAND = '''"""`provision tide`: a toy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base.syntax import CommandSpec, Word
from atlantis_netcfg.core.errors import ExitCode

if TYPE_CHECKING:
    from atlantis_netcfg.cli.base.syntax import Arguments

SITE = Word("site", "the site", is_required=True, example="scc")
TIDE = CommandSpec("tide", "say how high the water is", words=(SITE,))


def run_tide(arguments: Arguments) -> ExitCode:
    print(f"high water at {arguments.word('site')}")
    return ExitCode.DONE
'''


def test_new_command_needs_a_module_and_one_line(product: Copy) -> None:
    product.append("atlantis_netcfg/cli/tide.py", COMMAND)
    last = '    "help version": f"{_CLI}.help:version",\n'
    product.replace(
        "atlantis_netcfg/cli/base/commands.py", last, f'    "tide": "atlantis_netcfg.cli.tide:tide",\n{last}'
    )

    assert product.provision("tide", "site=scc") == "high water at scc\n"
    assert "say how high the water is" in product.provision("help")
    assert "site=" in product.provision("tide", "--help")
    product.provision("tide", code=3)  # a word is missing


def items(product: Copy, site: str, *, code: int) -> dict[str, str]:
    """Ids of items to their verdicts; with items for a person, whom there is none, the list is not green: code 6."""
    told = json.loads(product.provision("check", f"site={site}", "--rehearse", "--json", code=code))
    return {item["id"]: item["verdict"] for item in told["items"]}


CHECK = '''"""The router bears its own name: a toy."""

from __future__ import annotations

from dataclasses import dataclass

from atlantis_netcfg.checklist.probes.site_checks.parse import OwnSite, ask, fail, good, rows, step
from atlantis_netcfg.checklist.probes.base import ProbeResult, Step


def name_check(site: OwnSite) -> Step:
    return step("name", "The router bears its own name", Name(site), site.hosts[:1])


@dataclass(frozen=True, slots=True)
class Name:
    site: OwnSite

    def asks(self):
        return ask("identity", self.site, "/system/identity", "name")

    def judge(self, results):
        (row,) = rows(results["identity"], self.site.router.name, "its name", "name")
        right = row["name"] == self.site.router.name
        return ProbeResult((good("named", row["name"]) if right else fail("misnamed", row["name"], "run the site"),))
'''


def test_new_site_check_needs_a_module_and_one_row(product: Copy) -> None:
    product.append("atlantis_netcfg/checklist/probes/site_checks/name.py", CHECK)
    table = "atlantis_netcfg/checklist/probes/site_checks/__init__.py"
    product.replace(table, '    "poe": poe_check,\n', '    "poe": poe_check,\n    "name": name_check,\n')
    other = "from atlantis_netcfg.checklist.probes.site_checks.poe import poe_check\n"
    added = "from atlantis_netcfg.checklist.probes.site_checks.name import name_check\n"
    product.replace(table, other, added + other)

    assert items(product, "scc", code=0)["scc/site/name"] == "PASS"


PROBE = '''

_of_the_column = steps


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """The items of the column, and a toy: the router has an interface for 4G."""
    if cell.router is None:
        return _of_the_column(cell)
    probe = Interface(cell.router.name)
    kind, phase = report.ItemKind.AUTOMATIC, report.Phase.BENCH
    toy = base.Step(name="port", title="The router has its port", kind=kind, phase=phase, probe=probe)
    return (*_of_the_column(cell), toy)


class Interface:
    def __init__(self, router):
        self.router = router

    def asks(self):
        from atlantis_netcfg.links.status import Query
        from atlantis_netcfg.checklist.probes.base import RouterOsQuery

        query = Query("/interface/ethernet", "print", (), ("name",))
        return (RouterOsQuery("ports", self.router, query),)

    def judge(self, results):
        from atlantis_netcfg.checklist.probes.base import ProbeResult

        there = {row["name"] for row in results["ports"].rows}
        verdict = Verdict.PASS if "ether2" in there else Verdict.FAIL
        return ProbeResult((LinkFinding(verdict, "port", f"{len(there)} ports"),))
'''


def test_new_probe_needs_one_step_in_its_module(product: Copy) -> None:
    product.append("atlantis_netcfg/checklist/probes/link_probe.py", PROBE)

    assert items(product, "te4sea", code=6)["te4sea/4g/port"] == "PASS"
