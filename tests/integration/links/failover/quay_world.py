"""A declared router on the twin's clock, and a world in which addresses fall silent: hours pass in an instant."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from atlantis_netcfg.emulator.routeros.answers import Caller
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.spec import DeviceMode
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.links.policy import LinkRoute, active_link
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.routeros.render import router

INVENTORY = Path(__file__).parents[4] / "inventory"
STEP_S = 1.0


@cache
def shipped() -> Inventory:
    return load(INVENTORY)


NEWER = " configuration.installation=outdoor"
"""Of a radio, from RouterOS 7.17 on; an older device is refused."""


@dataclass
class World:
    """One site's router; `at(...)` lets time pass and says which bearer carries the traffic from when on."""

    site: str
    version: str = "7.18.2"
    device_mode: DeviceMode | None = None
    declaration: Inventory = field(default_factory=shipped)
    now: float = 1000.0
    device: Device = field(init=False)
    caller: Caller = field(init=False)
    seen: list[tuple[float, str | None]] = field(default_factory=list)
    """From when on which bearer was active."""
    _revision: int | None = None

    def __post_init__(self) -> None:
        host = self.declaration.hosts[f"{self.site}-router"]
        (twin,) = site_spec(self.declaration, [host]).emulators
        text = router(self.declaration, host)
        if self.version == "7.16":
            text = text.replace(NEWER, "")
        adopted = f"add address={twin.router.management.address} "  # stands there before anything is declared
        seed = "".join(line for line in text.splitlines(keepends=True) if not line.startswith(adopted))
        changes = {"seed": seed, "version": self.version}
        spec = twin.router.model_copy(
            update=changes | ({} if self.device_mode is None else {"device_mode": self.device_mode})
        )
        self.device = Device(spec, lambda: self.now)
        self.enter()

    def enter(self) -> None:
        user = self.device.spec.users[0]
        self.caller = self.device.login(user.name, user.password, via="api", address="10.64.101.10")

    def ways(self) -> tuple[LinkRoute, ...]:
        return tuple(
            LinkRoute(
                each.name,
                str(each.gateway),
                str(each.address),
                tuple(str(canary) for canary in each.canaries),
                kind=each.kind.value,
                is_metered=each.metered,
            )
            for each in self.declaration.sites[self.site].bearers
        )

    def rows(self, menu: str, *queries: str) -> list[dict[str, str]]:
        answers = self.device.run(self.caller, [f"{menu}/print", *queries])
        return [dict(word[1:].partition("=")[::2] for word in each.words) for each in answers if each.kind == "!re"]

    def active(self) -> str | None:
        return active_link(self.rows("/ip/route"), self.ways())

    def canaries(self, *names: str) -> tuple[str, ...]:
        return tuple(canary for way in self.ways() if way.name in names for canary in way.probe_targets)

    def silence(self, addresses: Iterable[str]) -> None:
        self.device.silence(addresses)

    def lose(self, *names: str) -> None:
        """Let the canaries of these bearers be silent, and all others answer."""
        self.silence(self.canaries(*names))

    def passes(self, seconds: float) -> None:
        """Let time pass, a second at a time, and note when another bearer takes over."""
        self._note(self.active())
        end = self.now + seconds
        while self.now < end:
            self.now = min(end, self.now + STEP_S)
            self.device.tick()
            if self._revision != self.device.revision:
                self._revision = self.device.revision
                self._note(self.active())

    def _note(self, active: str | None) -> None:
        if not self.seen or self.seen[-1][1] != active:
            self.seen.append((self.now, active))

    def run(self, command: str) -> None:
        script = self.device.run(self.caller, ["/execute", f"=script={command}", "=as-string="])
        assert script[0].words == ("=ret=",), script

    def order(self) -> list[str | None]:
        """The bearers that carried traffic, one after the other."""
        return [name for _, name in self.seen]

    def reboot(self) -> None:
        self.device.reboot()
        self.enter()
        self._note(self.active())

    def errors(self) -> list[str]:
        return [row["message"] for row in self.rows("/log") if row["topics"].startswith("script,error")]
