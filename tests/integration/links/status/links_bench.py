"""A site of twins, configured as declared, at whose links a test looks; what is sick about it is a test's choice."""

import asyncio
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.emulator.routeros import EmulatorSpec, RouterLink, RunningSite, SiteSpec
from atlantis_netcfg.inventory import Host, Inventory, choose, load
from atlantis_netcfg.operations.apply import perform
from atlantis_netcfg.operations.common.kinds import is_other_lte_unit, is_supported
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.operations.common.request import Request, Target
from atlantis_netcfg.operations.common.schedule import with_other_ends
from atlantis_netcfg.operations.links.collect import LinksStatus, collect_links
from atlantis_netcfg.operations.lte.run import perform as perform_lte
from atlantis_netcfg.operations.lte.units import emulated_units
from atlantis_netcfg.runs.report.links import LinksReport

ROOT = Path(__file__).resolve().parents[4]
INVENTORY = ROOT / "inventory"
PATIENCE_S = 1.0
"""For twins on this computer."""
NOWHERE = 1
"""A port on which nobody listens."""


@dataclass(slots=True)
class Bench:
    """A running site."""

    declaration: Inventory
    site: str
    twins: RunningSite
    request: Request
    targets: dict[str, Target] = field(default_factory=dict)
    """Twins that a test lets stand elsewhere."""

    def look(self, *only: str) -> LinksStatus:
        """The operation."""
        hosts = choose(self.declaration, self.site, only)
        request = self.request.model_copy(update={"targets": self.request.targets | self.targets})
        return asyncio.run(collect_links(self.declaration, self.site, hosts, request, ignore, PATIENCE_S))

    def report(self, *only: str) -> LinksReport:
        """What a person and a program get of it."""
        return self.look(*only).report(self.site, self.declaration.sites[self.site].title, is_rehearsal=True)

    def do(self, twin: str, command: str, **arguments: Any) -> Any:  # noqa: ANN401 (JSON of any shape)
        """Command a twin."""
        return self.twins.do(twin, command, **arguments)

    def types(self, twin: str, *words: str) -> None:
        """Somebody types a command on a device."""
        answer = self.do(twin, "console", words=list(words))[-1]
        assert answer[0] == "!done", answer

    def hears(self, twin: str) -> bool:
        """Whether the other end is registered at a radio."""
        rows = self.do(twin, "console", words=["/interface/wireless/registration-table/print"])
        return any(kind == "!re" for kind, *_ in rows)

    def away(self, *names: str) -> None:
        """From here on nobody listens where these devices are."""
        self.targets |= {name: self.request.targets[name].model_copy(update={"port": NOWHERE}) for name in names}

    def lose(self, bearer: str) -> None:
        """The bearer's canaries fall silent, and the router has noticed: its default routes by them are out."""
        router = f"{self.site}-router"
        found = next(one for one in self.declaration.sites[self.site].bearers if one.name == bearer)
        self.do(router, "silence", addresses=[str(canary) for canary in found.canaries])
        for number in self._routes(router, [str(canary) for canary in found.canaries]):
            self.types(router, "/ip/route/set", f"=.id={number}", "=disabled=yes")

    def heal(self) -> None:
        """Everything that the methods here have broken is well again."""
        self.targets = {}
        router = f"{self.site}-router"
        self.do(router, "silence", addresses=[])
        canaries = [str(canary) for one in self.declaration.sites[self.site].bearers for canary in one.canaries]
        for number in self._routes(router, canaries):
            self.types(router, "/ip/route/set", f"=.id={number}", "=disabled=no")

    def _routes(self, router: str, gateways: Sequence[str]) -> list[str]:
        """The `.id` of the default routes by these gateways."""
        found = []
        for kind, *words in self.do(router, "console", words=["/ip/route/print"]):
            row = dict(word[1:].partition("=")[::2] for word in words)
            if kind == "!re" and row.get("gateway") in gateways:
                found.append(str(row[".id"]))
        return found


def masked(text: str) -> str:
    """Everything that is new with every look, and what the looks themselves have sent."""
    text = re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d (UTC|\w+ \([\d :-]+ UTC\))", "TIME", text)
    text = re.sub(r"(this month +)[0-9.]+ k?B", r"\1BYTES", text)
    return re.sub(r"127\.0\.0\.1(:| port )\d+", "ADDRESS", text)


def block(text: str, bearer: str) -> str:
    """What is said of one link."""
    return next(part for part in text.split("\n\n") if re.match(rf"\d+\. {re.escape(bearer)}:", part))


def inventory(folder: Path, changes: Mapping[str, tuple[str, str]]) -> Path:
    """A copy of the shipped inventory; in each of these files one text is replaced by another one."""
    root = folder / "inventory"
    shutil.copytree(INVENTORY, root)
    for name, (old, new) in changes.items():
        text = (root / name).read_text(encoding="utf-8")
        assert old in text, f"{name} has no {old}"
        (root / name).write_text(text.replace(old, new), encoding="utf-8")
    return root


@contextmanager
def bench(
    folder: Path,
    site: str,
    *only: str,
    root: Path = INVENTORY,
    spoil: Callable[[EmulatorSpec], EmulatorSpec] | None = None,
    ends: Mapping[str, int] | None = None,
) -> Iterator[Bench]:
    """The twins of a site, or `only` some of them, all near by, configured.

    `spoil` changes a twin before it starts; `ends`: how a device's configuration ends, where that is not 0.
    """
    declaration = load(root)
    chosen = choose(declaration, site, only)
    with ExitStack() as stack:
        units = stack.enter_context(
            emulated_units([host for host in chosen if is_other_lte_unit(host)], _made(folder / "units"))
        )
        twins = stack.enter_context(RunningSite(_spec(declaration, chosen, spoil), _made(folder / "twins")))
        targets = {name: _target(ready) for name, ready in twins.ready.items()}
        targets |= {name: unit.target for name, unit in units.items()}
        request = Request(state=folder / "state", rehearsed=True, targets=targets, command="test")
        asked = request.model_dump(mode="json")
        told = perform(root, list(twins.ready), asked, plan_only=False, decrypt=str)["per_host"]
        if units:
            told |= perform_lte(root, list(units), asked, plan_only=False, decrypt=str)["per_host"]
        found = {name: one["exit"] for name, one in told.items()}
        assert found == dict.fromkeys(targets, 0) | dict(ends or {}), told
        yield Bench(declaration, site, twins, request)


def _made(folder: Path) -> Path:
    folder.mkdir()
    return folder


def _spec(
    declaration: Inventory, chosen: Sequence[Host], spoil: Callable[[EmulatorSpec], EmulatorSpec] | None
) -> SiteSpec:
    hosts = with_other_ends(declaration, [host for host in chosen if is_supported(host)])
    spec = site_spec(declaration, hosts, along={host.name for host in hosts} - {host.name for host in chosen})
    near = tuple(twin.model_copy(update={"link": RouterLink()}) for twin in spec.emulators)
    return spec.model_copy(update={"emulators": tuple(map(spoil, near)) if spoil is not None else near})


def _target(ready: Mapping[str, Any]) -> Target:
    return Target(
        host=ready["host"], port=ready["api_ssl"], pin=ready["pin"], ssh=ready["ssh"], host_key=ready["host_key"]
    )
