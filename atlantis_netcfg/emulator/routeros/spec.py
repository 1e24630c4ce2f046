"""Specification of emulated routers and sites: board, version, device-mode, users, management path.

Everything here is data that survives a round trip through JSON
(`RouterSpec.model_validate_json(spec.model_dump_json())`).
"""

from __future__ import annotations

from datetime import UTC, datetime
from enum import StrEnum
from ipaddress import IPv4Address, IPv4Interface
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from atlantis_netcfg.emulator.routeros.radio._settings import RadioPair
from atlantis_netcfg.emulator.routeros.wire.link import RouterLink, WireBehaviour

ETHERNETS = tuple(f"ether{number}" for number in range(1, 9))


class _Spec(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class User(_Spec):
    """An account of the router; `group` is the name of a row of `/user/group`."""

    name: str
    password: str = ""
    group: str = "full"
    is_disabled: bool = False
    address: str = ""


class ManagementSpec(_Spec):
    """Management path of a router: `technician` sends packets into `port` to `address`.

    The port is a radio if the technician is at the other end of a radio link.
    """

    address: str = "10.64.101.1/24"
    port: str = "ether8"
    technician: str = "10.64.101.10"

    @property
    def local(self) -> str:
        """The router's own address, without prefix length."""
        return str(IPv4Interface(self.address).ip)

    @property
    def network(self) -> IPv4Address:
        """Address of the network shared by router and technician."""
        return IPv4Interface(self.address).network.network_address

    @model_validator(mode="after")
    def _addresses(self) -> Self:
        IPv4Interface(self.address)
        IPv4Address(self.technician)
        return self


class DeviceModeName(StrEnum):
    """Modes of `/system/device-mode` (Manual, Device-mode)."""

    HOME = "home"
    BASIC = "basic"
    ADVANCED = "advanced"
    ROSE = "rose"


class DeviceMode(_Spec):
    """`/system/device-mode`: a mode, individually switched features (`{"scheduler": False}`), and the flag."""

    mode: DeviceModeName = DeviceModeName.ADVANCED
    features: dict[str, bool] = Field(default_factory=dict)
    is_flagged: bool = False


class Deviation(StrEnum):
    """Deviations from the assumptions of engine and emulator; each value is an id in routeros/assumptions.py.

    Other deviations are set by `WireBehaviour`, `Execute`, `history_limit`, `unroll_delay_s` and `silent_timeout_s`.
    """

    AMBIGUOUS = "console-ambiguous"
    """A name that is cut short means the first that begins like it."""
    COUNTS = "api-count-only"
    """`count-only` prints the rows."""
    NO_PING = "api-ping-path"
    """There is no `/tool/ping`."""
    HISTORY_NAMES = "history-names-ids"
    """The history names rows by their number in a print."""
    HISTORY_ORDER = "history-newest-first"
    """The oldest entry comes first."""
    IDS = "api-ids-grow"
    """The `.id` of a row that was removed is used again."""
    JOB_TEXT = "on-event-60k"
    """A job of the scheduler keeps the first 4,096 bytes of its script."""
    LISTS = "inspect-whole"
    """An offered list loses a word in every other answer."""
    NAMES = "name-in-routes"
    """A route goes on naming an interface as it was called when the route was added."""
    NESTED_EXECUTE = "parse-nested"
    """`:execute` within a script gives the number of a job, also with `as-string`."""
    PARSE_WORDS = "parse-words"
    """The parser tells mistakes in words of its own."""
    PIN_WORDS = "lte-pin-words"
    """A driver of its own words."""
    POWER_LOSS = "safe-mode-power-loss"
    """What is in safe mode when the power fails is on the flash, and stays."""
    PROPERTIES = "api-unknown-property"
    """A property that no row has is refused."""
    QUERY_ORDER = "api-query-order"
    """Texts cannot be compared: `<` and `>` know numbers alone."""
    SCRIPT_ENTRIES = "safe-mode-counts-rows"
    """A script is one entry of the history."""
    SCRIPT_GOES_ON = "execute-stops"
    """A script goes on after an error."""
    SCRIPT_STAYS = "safe-mode-undoes-scripts"
    """What a script has changed stays when safe mode is unrolled."""
    SECOND_TAKER = "safe-mode-second-taker"
    """Safe mode goes to whoever takes it last."""
    SESSIONS = "api-sessions-newest-last"
    """The newest session comes first."""
    TIMES = "netwatch-values"
    """Intervals of netwatch are numbers of milliseconds."""


class Execute(StrEnum):
    """Behaviour of `/execute as-string` if its script stops at an error, or absence of `/execute`.

    Assumption: execute-error-text
    """

    OUTPUT = "output"
    """The error's text is the last line of the output."""
    TRAP = "trap"
    """The output is lost and the error comes as `!trap`."""
    NONE = "none"
    """`no such command`."""


class Radio(_Spec):
    """A radio on the board, driven by an installed package: `wireless`, or one called `wifi-...`."""

    name: str = "wlan1"
    """Factory name: `wlan1` with the older driver, `wifi1` with the newer."""
    power_dbm: float = 25.0
    """The most that the card sends."""
    gain_dbi: float = 16.0
    """Of the antenna built into the box."""


_Plmn = Annotated[str, Field(pattern=r"[0-9]{5,6}")]


class SimSpec(_Spec):
    """A SIM; 001-01 is the test network of 3GPP TS 36.508."""

    home: _Plmn = "00101"
    """The network whose card it is; in any other it roams."""
    pin: Annotated[str, Field(pattern=r"|[0-9]{4,8}")] = ""
    """Empty: the card asks for none."""
    tries: int = Field(default=3, ge=0, le=3)
    """Wrong PINs that it takes from now on; with none left it asks for its PUK."""


class CellSpec(_Spec):
    """The mobile network at the site."""

    plmn: _Plmn = "00101"
    operator: str = "EXAMPLE"
    bands: tuple[int, ...] = (3,)
    """LTE bands in which it can be heard."""
    apns: tuple[str, ...] = ()
    """Access points that it has; none: any name will do."""
    own_apn: str = "internet"
    """What it gives to a modem that asks for the network's own."""
    address: str = "100.72.9.14"
    """What it gives to the modem: carriers translate addresses (RFC 6598)."""
    denies: bool = False
    """It refuses this card."""
    cell_id: int = 3103242
    rsrp_dbm: int = -97
    rsrq_db: int = -9
    sinr_db: int = 6


class ModemSpec(_Spec):
    """The modem of a board; `sim` None is an empty slot, `cell` None is no coverage."""

    name: str = "lte1"
    """Factory name."""
    mbim: bool = True
    """Driven by MBIM: only then `use-network-apn` means anything (Manual, LTE/5G)."""
    bands: tuple[int, ...] = (1, 3, 7, 8, 20, 28, 38, 40)
    """LTE bands that it has."""
    sim: SimSpec | None = SimSpec()
    cell: CellSpec | None = CellSpec()


class Load(_Spec):
    """A device powered by a PoE port."""

    milliamps: int = Field(default=180, ge=0)
    volts: float = Field(default=24.0, ge=0)
    status: str | None = None
    """In place of `powered-on`: `short-circuit`, `overload`, `current-too-low`."""


class DiscoveryNeighbour(_Spec):
    """A device that announces its name by MNDP, CDP or LLDP."""

    identity: str
    interface: str
    """Of the router, on which it is heard."""
    mac: str
    address: str | None = None
    platform: str = "MikroTik"
    board: str = ""
    version: str = ""


class Validity(_Spec):
    """Validity period of a certificate."""

    since: datetime
    until: datetime


class NearbyStation(_Spec):
    """An 802.11 client near the router: it joins a network that has its name and passphrase."""

    mac: str
    ssid: str
    passphrase: str
    signal_dbm: float = -58.0
    """What the router hears of it, however strong its own radio is set."""


class Environment(_Spec):
    """Surroundings of a router; empty by default."""

    cards: dict[str, str] = Field(default_factory=dict)
    """Address to the MAC that answers there: they answer pings and ARP, like `neighbours` of the router's own spec."""
    called: tuple[DiscoveryNeighbour, ...] = ()
    plugged: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Port (factory name) to the MACs that its bridge has heard on it."""
    loads: dict[str, Load] = Field(default_factory=dict)
    """PoE port (factory name) to what hangs on it."""
    dhcp_servers: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Interface to the MACs of other DHCP servers on it: `/ip/dhcp-server/alert` tells of them where it has a row."""
    leases: dict[str, str] = Field(default_factory=dict)
    """Address to the `status` of its lease; others are `waiting`."""
    tunnels: dict[str, str] = Field(default_factory=dict)
    """OpenVPN client to the address (with prefix length) that its server gives it: it is connected."""
    stations: tuple[NearbyStation, ...] = ()
    """Clients near its radio: those whose network it opens are in its registration table."""
    time_server: str | None = None
    """The time server that answers; None: none does."""
    validity: dict[str, Validity] = Field(default_factory=dict)
    """Certificate to what `/certificate` shows of its dates; the TLS of api-ssl presents it as it was made."""

    @model_validator(mode="after")
    def _addresses(self) -> Self:
        for address in self.tunnels.values():
            IPv4Interface(address)
        return self


class RouterSpec(_Spec):
    """An emulated router after adoption: factory rows without a default configuration, then `seed`."""

    name: str
    version: str = "7.18.2"
    board: str = "RB5009UPr+S+"
    architecture: str = "arm64"
    serial_number: str = "HGX0A1B2C3D"
    ports: tuple[str, ...] = ETHERNETS
    poe_ports: tuple[str, ...] = ETHERNETS
    radios: tuple[Radio, ...] = ()
    modem: ModemSpec | None = None
    device_mode: DeviceMode = DeviceMode()
    packages: tuple[str, ...] = ("routeros",)
    users: tuple[User, ...] = (User(name="provision"),)
    management: ManagementSpec = ManagementSpec()
    history_limit: int = Field(default=100, ge=1)
    """Actions that `/system/history` keeps; one more in safe mode and the session leaves it without a word."""
    unroll_delay_s: float = Field(default=2.15, ge=0)
    """From a clean close of the session that holds safe mode until its changes are undone.

    Assumption: safe-mode-close
    """
    silent_timeout_s: float = Field(default=540.0, ge=0)
    """From a silent loss of that session until the router notices. Assumption: api-silent-session"""
    deviations: tuple[Deviation, ...] = ()
    """What it does otherwise than assumed."""
    clock: datetime = datetime(2026, 1, 1, 8, 0, tzinfo=UTC)
    """What the router's clock shows when the twin starts; a box without battery wakes up in 1970."""
    seed: str = ""
    """Export-style text that was applied when the router was adopted; not in the history."""
    certificates: tuple[str, ...] = ("atlantis-api",)
    neighbours: tuple[str, ...] = ()
    """Addresses that answer `/ping` when a route leads to them."""
    around: Environment = Environment()
    """What else stands around it: cards, loads on PoE, the far end of a VPN, other DHCP servers."""
    execute: Execute = Execute.OUTPUT
    disk_bytes: int = Field(default=1041235968, ge=0)
    """What its files may take together."""
    serial: bool = False
    """It has a serial line: a pty whose path the running twin tells."""
    factory: bool = False
    """As it comes out of its box: the console asks about licence, default configuration and password.

    It has the default configuration and the users of the spec (name `admin`), no certificate and no management address.
    """
    first_contact: ManagementSpec | None = None
    """A second way in, beside `management`: a laptop on a port of the factory's network."""

    @property
    def answering(self) -> tuple[str, ...]:
        """All addresses that respond to pings and ARP."""
        return tuple(dict.fromkeys((*self.neighbours, *self.around.cards)))

    @property
    def paths(self) -> tuple[ManagementSpec, ...]:
        """All management paths of the router, that of the inventory first."""
        return (self.management,) if self.first_contact is None else (self.management, self.first_contact)

    @model_validator(mode="after")
    def _ports(self) -> Self:
        there = {*self.ports, *(radio.name for radio in self.radios)}
        unknown = {*(path.port for path in self.paths), *self.poe_ports} - there
        if unknown:
            raise ValueError(f"no such port on {self.name}: {', '.join(sorted(unknown))}")
        return self


class TwinSpec(_Spec):
    """A router with the link to it and its adjustable behaviour."""

    router: RouterSpec
    link: RouterLink = RouterLink()
    knobs: WireBehaviour = WireBehaviour()
    ports: dict[int, int] = Field(default_factory=dict)
    """Loopback ports wished for, by service port; the kernel chooses the others."""


class SiteSpec(_Spec):
    """All emulated routers of a site."""

    name: str
    twins: tuple[TwinSpec, ...]
    pairs: tuple[RadioPair, ...] = ()
    """Radio links between them."""

    @model_validator(mode="after")
    def _ends(self) -> Self:
        radios = {twin.router.name: [radio.name for radio in twin.router.radios] for twin in self.twins}
        for pair in self.pairs:
            for name, radio in ((pair.near, pair.near_radio), (pair.far, pair.far_radio)):
                if radio not in radios.get(name, ()):
                    raise ValueError(f"there is no radio {radio} on a twin called {name}")
        return self

    @model_validator(mode="after")
    def _names(self) -> Self:
        names = [twin.router.name for twin in self.twins]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two twins are called {', '.join(twice)}")
        return self
