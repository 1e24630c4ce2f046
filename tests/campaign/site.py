"""The site on which faults strike: a router, a bridge whose far end is reached over its radio, and a 4G unit.

A real run meets them at their declared addresses, which in this process's own network lead through a relay to twins.
"""

import json
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from quay import _inventory, _opened

from atlantis_netcfg.emulator.routeros import Air, SiteSpec, SpawnedSite, User
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.runs import Store
from campaign.relay import Relay

CHECKOUT = Path(__file__).resolve().parents[2]
ROUTER, NEAR, FAR = "coastal-router", "coastal-cpe", "scc-cpe"
ADDRESSES = {ROUTER: "10.64.101.1", NEAR: "10.10.0.4", FAR: "10.10.0.3", "coastal-4g": "10.10.1.1"}
"""What `site=coastal` goes to, and the other end of its bridge."""
SERVICES = {8729: "api_ssl", 22: "ssh"}
"""What leads to the twins."""
STRANGER = User(name="stranger", password="as they come")
ADMIN = User(name="colleague", password="another one")
VERSIONS = ("7.18.2", "7.18.2", "7.21.5", "7.16")
"""Of the router: safe mode for programs came with 7.18."""
NEXT_VERSION = {"7.16": "7.16.2", "7.18.2": "7.18.3", "7.21.5": "7.21.6"}
"""Of which packages are sent: so near that the configuration stays what it is."""
NO_ACCESS_POINT = ("7.16",)
STATES = ("adopted", "configured", "drifted", "foreign")

DRIFTS: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "coastal-router": (
        ("/ip/firewall/filter/set", "=numbers=*4", "=disabled=yes"),
        ("/system/identity/set", "=name=somebody-was-here"),
        ("/ip/dns/set", "=servers=9.9.9.9"),
        ("/ip/dhcp-server/lease/remove", "=numbers=*1"),
    ),
    NEAR: (("/interface/wireless/set", "=numbers=wlan1", "=ssid=left-behind"), ("/system/identity/set", "=name=cpe")),
    FAR: (("/interface/wireless/set", "=numbers=wlan1", "=ssid=left-behind"), ("/system/identity/set", "=name=cpe")),
    "coastal-4g": (("/system/identity/set", "=name=modem"), ("/ip/dns/set", "=servers=9.9.9.9")),
}
"""What people do to configured devices. The name of the network is changed at both ends, or they would not meet."""
FOREIGN = ("/ip/dns/static/add", "=name=printer.lan", "=address=192.0.2.51", "=comment=foreign")
"""A row of somebody else's, which stays."""


@dataclass
class Site:
    folder: Path
    inventory: Path
    relay: Relay
    twins: SpawnedSite
    state: str
    """One of STATES: how the devices stood at the beginning."""
    version: str
    stores: list[Path] = field(default_factory=list)

    def do(self, host: str, command: str, **arguments: Any) -> Any:  # noqa: ANN401 - JSON of any shape
        return self.twins.do(host, command, **arguments)

    def console(self, host: str, *words: str, user: str | None = None) -> list[list[str]]:
        answers: list[list[str]] = self.do(host, "console", words=list(words), user=user)
        return answers

    def edit(self, host: str, *words: str) -> None:
        answers = self.console(host, *words, user=ADMIN.name)
        assert answers[-1][0] == "!done", (host, words, answers)
        assert all(answer[0] != "!trap" for answer in answers), (host, words, answers)

    def skip(self, seconds: float) -> None:
        self.do(NEAR, "skip", seconds=seconds)


def inventory(folder: Path, version: str) -> Path:
    """The shipped pilot with values that count as real, without the gateway: a computer is another campaign's.

    RouterOS before 7.17 cannot be told where its access point stands (`installation`): there the router opens none.
    """
    folder.mkdir(parents=True)
    root = _inventory(folder)
    if version in NO_ACCESS_POINT:
        router = root / "host_vars/coastal-router.yml"
        before, point, _ = router.read_text(encoding="utf-8").partition("  access_point:")
        assert point
        router.write_text(before, encoding="utf-8")
    hosts = root / "hosts.yml"
    hosts.write_text(
        hosts.read_text(encoding="utf-8")
        .replace("            coastal-gateway:\n", "", 1)
        .replace("        coastal-gateway:\n", "", 1)
    )
    (root / "host_vars/coastal-gateway.yml").unlink()
    site = root / "group_vars/coastal.yml"
    command = "            command: timedatectl show\n"
    before = site.read_text(encoding="utf-8")
    assert before.count(command) == 1
    site.write_text(before.replace(command, f"{command}            seen_from: laptop\n"), encoding="utf-8")
    return root


def specification(root: Path, version: str) -> SiteSpec:
    """The site's twins as `provision device adopt` leaves them."""
    declaration = load(root, decrypt=_opened)
    spec = site_spec(declaration, [declaration.hosts[name] for name in ADDRESSES], along={FAR})
    twins = []
    for twin in spec.emulators:
        name = twin.router.name
        users = (*twin.router.users, STRANGER, ADMIN)
        changes = {"users": users, **({"version": version} if name == "coastal-router" else {})}
        twins.append(twin.model_copy(update={"router": twin.router.model_copy(update=changes)}))
    air = Air(association_s=0.3, dfs_wait_s=0.5, weather_wait_s=0.5)
    pairs = tuple(pair.model_copy(update={"air": air}) for pair in spec.pairs)
    return spec.model_copy(update={"emulators": tuple(twins), "pairs": pairs})


@contextmanager
def spawned(spec: SiteSpec, folder: Path) -> Iterator[SpawnedSite]:
    """The twins in a process of their own, whose clock can be put forward."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "site.json"
    file.write_text(spec.model_dump_json(), encoding="utf-8")
    with (folder / "twins.log").open("ab") as errors:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "campaign.twins", str(file)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            start_new_session=True,
        )
    with SpawnedSite(process, folder / "twins.log") as twins:
        yield twins


class Stage:
    """What the rounds of one process share: the network, the declaration, and configured devices to begin with."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._inventories: dict[str, Path] = {}
        self._stack = ExitStack()
        self.relay = Relay(ADDRESSES, tuple(SERVICES))

    def __enter__(self) -> Self:
        for command in ("link set lo up", *(f"address add {each}/32 dev lo" for each in ADDRESSES.values())):
            subprocess.run(["ip", *command.split()], check=True)
        self._stack.enter_context(self.relay)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _inventory(self, version: str) -> Path:
        """Of routers of this version; the devices of a round keep what the reference was configured with."""
        if version not in self._inventories:
            self._inventories[version] = inventory(self.folder / f"pilot-{version}", version)
        return self._inventories[version]

    @contextmanager
    def site(self, name: str, state: str, version: str, flash: Path | None) -> Iterator[Site]:
        """Start the devices; `flash`: as a run has left them."""
        folder = self.folder / name
        if flash is not None:
            shutil.copytree(flash, folder / "twins", ignore=shutil.ignore_patterns("*.log", "site.json"))
        inventory = self._inventory(version)
        with spawned(specification(inventory, version), folder / "twins") as twins:
            self.lead(twins)
            site = Site(folder, inventory, self.relay, twins, state, version)
            yield site

    def lead(self, twins: SpawnedSite) -> None:
        """Let the declared addresses lead to these twins; requests are counted anew."""
        ports = {host: twins.ready[host] for host in ADDRESSES}
        self.relay.lead({host: {at: ready[name] for at, name in SERVICES.items()} for host, ready in ports.items()})

    def pin(self, store: Path, twins: SpawnedSite) -> None:
        """What `provision device adopt` has pinned on this laptop."""
        for host in ADDRESSES:
            Store(store).pins.change(host, twins.ready[host]["pin"])
            Store(store).pins.change_host_key(host, twins.ready[host]["host_key"])


def disturb(site: Site, chance: random.Random) -> None:
    """Bring configured devices into the state of the round."""
    if site.state == "drifted":
        for host, edits in DRIFTS.items():
            for edit in edits:
                if host in (NEAR, FAR) or chance.random() < 0.7:
                    site.edit(host, *edit)
    if site.state == "foreign":
        for host in ("coastal-router", "coastal-4g"):
            site.edit(host, *FOREIGN)
        site.edit("coastal-router", "/system/identity/set", "=name=somebody-was-here")
        for host in (NEAR, FAR):
            site.edit(host, "/interface/wireless/set", "=numbers=wlan1", "=ssid=left-behind")


def saved(site: Site) -> str:
    """The flash of all twins as text, for a look at a round that has gone wrong."""
    return json.dumps({host: str(site.do(host, "export", show_sensitive=True)) for host in ADDRESSES}, indent=1)
