"""Two ends of a radio bridge on twins, in one event loop and in time that jumps."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeVar

sys.path.insert(0, str(Path(__file__).parents[2] / "routeros" / "engine"))

from collections.abc import Callable, Coroutine

from engine_bench import PASSWORD as ENGINE_PASSWORD
from engine_bench import run, without_header

from atlantis_netcfg.core.events import Event
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import (
    Air,
    EmulatedRouter,
    EmulatedSite,
    EmulatorSpec,
    ManagementSpec,
    Radio,
    RadioLink,
    RadioPair,
    RouterSpec,
    SiteSpec,
    User,
)
from atlantis_netcfg.routeros import DeviceJob, DeviceResult, Endpoint, JobMode, desired
from atlantis_netcfg.routeros.pair import Pair, converge_pair
from atlantis_netcfg.routeros.rsc import quote
from atlantis_netcfg.runs import Journal, RunStart, Store

T = TypeVar("T")
PASSWORD = ENGINE_PASSWORD
TECHNICIAN = "10.10.0.10"
ADDRESSES = {"near": "10.10.0.1/24", "far": "10.10.0.2/24"}
LINK_TIMEOUT_S = 300.0
KEY = "the old key of both"

LEGACY = """\
/interface bridge
add comment="atlantis: bridge" name=bridge
/interface wireless security-profiles
add authentication-types=wpa2-psk comment="atlantis: ptp" mode=dynamic-keys name=ptp wpa2-pre-shared-key={key}
/interface wireless
set [ find default-name=wlan1 ] band=5ghz-a/n channel-width=20mhz country=portugal disabled=no frequency={frequency} \\
    installation=outdoor mode={mode} nv2-preshared-key={key} nv2-security=enabled scan-list=default \\
    security-profile=ptp ssid={ssid} wireless-protocol={protocol}
/interface bridge port
add bridge=bridge comment="atlantis: cable" interface=ether1
add bridge=bridge comment="atlantis: radio" interface=wlan1
"""
WIFI = """\
/interface bridge
add comment="atlantis: bridge" name=bridge
/interface wifi
set [ find default-name=wifi1 ] channel.band=5ghz-ax {frequencies} channel.width=20mhz \\
    configuration.country=Portugal configuration.installation=outdoor configuration.mode={mode} \\
    configuration.ssid={ssid} disabled=no security.authentication-types=wpa2-psk security.passphrase={key}
/interface bridge port
add bridge=bridge comment="atlantis: cable" interface=ether1
add bridge=bridge comment="atlantis: radio" interface=wifi1
"""
_WIFI_MODES = {"bridge": "ap", "station-bridge": "station-bridge"}
_ADDRESS = "/ip address\nset [ find ] interface=bridge\n"


@dataclass(frozen=True)
class Words:
    """What an end is set to."""

    ssid: str = "old name"
    key: str = KEY
    frequency: int = 5500
    protocol: str = "802.11"


def text(family: str, mode: str, words: Words) -> str:
    values = {
        "ssid": quote(words.ssid),
        "key": quote(words.key),
        "frequency": words.frequency,
        "protocol": words.protocol,
    }
    if family == "legacy":
        return LEGACY.format(mode=mode, **values)
    frequencies = f"channel.frequency={words.frequency}" if mode == "bridge" else ""
    return WIFI.format(mode=_WIFI_MODES[mode], frequencies=frequencies, **values)


@dataclass
class PairBench:
    """Both twins, their link, and what is needed to converge them; `async with` it."""

    tmp_path: Path
    family: str = "legacy"
    near_mode: str = "bridge"
    air: Air = field(default_factory=Air)
    spec: dict[str, Any] = field(default_factory=dict)
    near_spec: dict[str, Any] = field(default_factory=dict)
    far_spec: dict[str, Any] = field(default_factory=dict)
    words: Words = Words()
    """Both ends before."""
    events: list[Event] = field(default_factory=list)
    site: EmulatedSite = field(init=False)

    def __post_init__(self) -> None:
        radio = "wlan1" if self.family == "legacy" else "wifi1"
        pair = RadioPair(near="near", far="far", near_radio=radio, far_radio=radio, air=self.air)
        self.site = EmulatedSite(
            SiteSpec(name="quay", emulators=(self._twin("near", radio), self._twin("far", radio)), pairs=(pair,)),
            self.tmp_path / "twins",
        )

    def mode(self, name: str) -> str:
        other = {"bridge": "station-bridge", "station-bridge": "bridge"}
        return self.near_mode if name == "near" else other[self.near_mode]

    def _twin(self, name: str, radio: str) -> EmulatorSpec:
        spec = {
            "name": name,
            "version": "7.18.2",
            "board": "SXTsq 5 ac",
            "ports": ("ether1",),
            "poe_ports": (),
            "radios": (Radio(name=radio),),
            "packages": ("routeros", "wireless" if self.family == "legacy" else "wifi-qcom"),
            "users": (User(name="provision", password=PASSWORD),),
            "management": ManagementSpec(
                address=ADDRESSES[name], port="ether1" if name == "near" else radio, technician=TECHNICIAN
            ),
            "seed": text(self.family, self.mode(name), self.words) + _ADDRESS,
        }
        return EmulatorSpec(router=RouterSpec(**{**spec, **self.spec, **getattr(self, f"{name}_spec")}))

    async def __aenter__(self) -> Self:
        await self.site.start()
        assert self.link.up, self.link.down_reason
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.site.stop()

    @property
    def link(self) -> RadioLink:
        return self.site.links[0]

    def router(self, name: str) -> EmulatedRouter:
        return self.site.routers[name]

    def export(self, name: str) -> str:
        return without_header(self.router(name).export(show_sensitive=True))

    def exports(self) -> tuple[str, str]:
        return self.export("near"), self.export("far")

    @property
    def store(self) -> Store:
        return Store(self.tmp_path / "state")

    def job(self, name: str, words: Words, **changes: Any) -> DeviceJob:  # noqa: ANN401 - fields of DeviceJob
        router = self.router(name)
        endpoint = Endpoint(router.host, router.ports["api-ssl"], "provision", Secret(PASSWORD), router.pin)
        standard = {
            "name": name,
            "site": "quay",
            "address": router.spec.management.local,
            "endpoint": endpoint,
            "desired_state": desired.read(text(self.family, self.mode(name), words)),
            "events": self.events.append,
        }
        return DeviceJob(**{**standard, **changes})

    def journal(self) -> Journal:
        started = RunStart(
            site="quay", revision="", tool="", hosts=("near", "far"), rehearsed=False, command="provision"
        )
        return self.store.start(started)

    async def converge(
        self,
        words: Words,
        mode: JobMode = JobMode.APPLY,
        *,
        far_words: Words | None = None,
        **changes: Any,  # noqa: ANN401 - fields of Pair
    ) -> tuple[DeviceResult, DeviceResult]:
        with self.journal() as journal:
            near, far = (
                self.job(name, each, journal=journal) for name, each in (("near", words), ("far", far_words or words))
            )
            pair = Pair(near, far, **{"link_timeout_s": LINK_TIMEOUT_S, **changes})
            return await converge_pair(pair, mode=mode)

    def far_first(self) -> bool:
        """Whether the far end was told of its change before the near one was."""
        moments = [
            event.device for event in self.events if event.stage == "applying" or "radio was changed" in event.message
        ]
        return moments[:1] == ["far"]


def on(bench: PairBench, act: Callable[[PairBench], Coroutine[Any, Any, T]]) -> T:
    """Run `act` on a bench whose twins are up and linked."""

    async def main() -> T:
        async with bench:
            return await act(bench)

    return run(main())


def without_job(export: str) -> str:
    """Leave out the far end's job, which stays as long as its safe mode may take its own removal back."""
    head, _, rest = export.partition("/system scheduler\n")
    return head + rest[rest.index("\n/") + 1 :] if "\n/" in rest else head
