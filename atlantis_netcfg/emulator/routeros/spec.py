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
    """An abbreviated name selects the first name that begins with it."""
    COUNTS = "api-count-only"
    """`count-only` returns the rows."""
    NO_PING = "api-ping-path"
    """`/tool/ping` does not exist."""
    HISTORY_NAMES = "history-names-ids"
    """The history identifies rows by their number in a print."""
    HISTORY_ORDER = "history-newest-first"
    """The oldest entry is listed first."""
    IDS = "api-ids-grow"
    """The `.id` of a removed row is reused."""
    JOB_TEXT = "on-event-60k"
    """A scheduler job keeps only the first 4,096 bytes of its script."""
    LISTS = "inspect-whole"
    """Every other response lacks one word of an offered list."""
    NAMES = "name-in-routes"
    """A route keeps showing the interface name from the time when the route was added."""
    NESTED_EXECUTE = "parse-nested"
    """`:execute` within a script returns a job number, even with `as-string`."""
    PARSE_WORDS = "parse-words"
    """The parser has different wording for errors."""
    PIN_WORDS = "lte-pin-words"
    """`pin-status` has the driver's own wording."""
    POWER_LOSS = "safe-mode-power-loss"
    """Safe-mode changes are already on the flash when the power fails, and are kept."""
    PROPERTIES = "api-unknown-property"
    """A property that no row has is rejected."""
    QUERY_ORDER = "api-query-order"
    """Texts cannot be compared: `<` and `>` accept only numbers."""
    SCRIPT_ENTRIES = "safe-mode-counts-rows"
    """A script is a single entry of the history."""
    SCRIPT_GOES_ON = "execute-stops"
    """A script continues after an error."""
    SCRIPT_STAYS = "safe-mode-undoes-scripts"
    """Changes by a script are kept when safe mode is rolled back."""
    SECOND_TAKER = "safe-mode-second-taker"
    """Safe mode is transferred to the latest session that requests it."""
    SESSIONS = "api-sessions-newest-last"
    """The newest session is listed first."""
    TIMES = "netwatch-values"
    """Netwatch intervals are numbers of milliseconds."""


class Execute(StrEnum):
    """Behaviour of `/execute as-string` if its script stops at an error, or absence of `/execute`.

    Assumption: execute-error-text
    """

    OUTPUT = "output"
    """The error text is the last line of the output."""
    TRAP = "trap"
    """The output is lost, and the error is returned as `!trap`."""
    NONE = "none"
    """`/execute` does not exist: `no such command`."""


class Radio(_Spec):
    """A radio on the board, driven by an installed package: `wireless`, or one called `wifi-...`."""

    name: str = "wlan1"
    """Factory name: `wlan1` with the older driver, `wifi1` with the newer."""
    power_dbm: float = 25.0
    """Maximum transmit power of the card."""
    gain_dbi: float = 16.0
    """Gain of the built-in antenna."""


_Plmn = Annotated[str, Field(pattern=r"[0-9]{5,6}")]


class SimSpec(_Spec):
    """A SIM; 001-01 is the test network of 3GPP TS 36.508."""

    home: _Plmn = "00101"
    """Home network of the card; in any other network it roams."""
    pin: Annotated[str, Field(pattern=r"|[0-9]{4,8}")] = ""
    """Empty: the card requires no PIN."""
    tries: int = Field(default=3, ge=0, le=3)
    """Remaining attempts for a wrong PIN; at 0 the card requires its PUK."""


class CellSpec(_Spec):
    """The mobile network at the site."""

    plmn: _Plmn = "00101"
    operator: str = "EXAMPLE"
    bands: tuple[int, ...] = (3,)
    """LTE bands of the network."""
    apns: tuple[str, ...] = ()
    """Supported access points (APN); empty: any name is accepted."""
    own_apn: str = "internet"
    """APN assigned to a modem that asks for the network's default."""
    address: str = "100.72.9.14"
    """Address assigned to the modem, from the range of carrier-grade NAT (RFC 6598)."""
    denies: bool = False
    """The network rejects this card."""
    cell_id: int = 3103242
    rsrp_dbm: int = -97
    rsrq_db: int = -9
    sinr_db: int = 6


class ModemSpec(_Spec):
    """The modem of a board; `sim` None is an empty slot, `cell` None is no coverage."""

    name: str = "lte1"
    """Factory name."""
    mbim: bool = True
    """Uses MBIM, without which `use-network-apn` has no effect (Manual, LTE/5G)."""
    bands: tuple[int, ...] = (1, 3, 7, 8, 20, 28, 38, 40)
    """LTE bands supported by the modem."""
    sim: SimSpec | None = SimSpec()
    cell: CellSpec | None = CellSpec()


class Load(_Spec):
    """A device powered by a PoE port."""

    milliamps: int = Field(default=180, ge=0)
    volts: float = Field(default=24.0, ge=0)
    status: str | None = None
    """Status instead of `powered-on`: `short-circuit`, `overload`, `current-too-low`."""


class DiscoveryNeighbour(_Spec):
    """A device that announces its name by MNDP, CDP or LLDP."""

    identity: str
    interface: str
    """Interface of the router on which it is received."""
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
    """Level at which the router receives it, whatever the transmit power of the router's radio."""


class Environment(_Spec):
    """Surroundings of a router; empty by default."""

    cards: dict[str, str] = Field(default_factory=dict)
    """Address to the MAC that responds to pings and ARP there, like `neighbours` of the router's specification."""
    called: tuple[DiscoveryNeighbour, ...] = ()
    plugged: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Port (factory name) to the MACs that the bridge learned on it."""
    loads: dict[str, Load] = Field(default_factory=dict)
    """PoE port (factory name) to the device powered by it."""
    dhcp_servers: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Interface to the MACs of other DHCP servers on it; `/ip/dhcp-server/alert` reports them if it has a row."""
    leases: dict[str, str] = Field(default_factory=dict)
    """Address to the `status` of its lease; all others are `waiting`."""
    tunnels: dict[str, str] = Field(default_factory=dict)
    """OpenVPN client to the address with prefix length from its server; such a client is connected."""
    stations: tuple[NearbyStation, ...] = ()
    """Clients in radio range; the registration table lists those whose network the router provides."""
    time_server: str | None = None
    """Address of the time server that responds; None: none does."""
    validity: dict[str, Validity] = Field(default_factory=dict)
    """Certificate to the dates shown by `/certificate`; the TLS of api-ssl still presents the original."""

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
    """Number of actions in `/system/history`; one more makes a session leave safe mode without notice."""
    unroll_delay_s: float = Field(default=2.15, ge=0)
    """Seconds from a clean close of the session that holds safe mode until its changes are undone.

    Assumption: safe-mode-close
    """
    silent_timeout_s: float = Field(default=540.0, ge=0)
    """Seconds from a silent loss of that session until the router notices. Assumption: api-silent-session"""
    deviations: tuple[Deviation, ...] = ()
    """Deviations from the assumptions."""
    clock: datetime = datetime(2026, 1, 1, 8, 0, tzinfo=UTC)
    """Time of the router's clock when the emulator starts; a device without battery starts in 1970."""
    seed: str = ""
    """Export-style text applied when the router was adopted; not in the history."""
    certificates: tuple[str, ...] = ("atlantis-api",)
    neighbours: tuple[str, ...] = ()
    """Addresses that answer `/ping` when a route leads to them."""
    around: Environment = Environment()
    """Surroundings: network cards, PoE loads, the far end of a VPN, other DHCP servers."""
    execute: Execute = Execute.OUTPUT
    disk_bytes: int = Field(default=1041235968, ge=0)
    """Capacity for all files together."""
    serial: bool = False
    """The router has a serial line: a pty whose path the running emulator reports."""
    factory: bool = False
    """Factory-new: the console asks about licence, default configuration and password.

    It has the default configuration and the users of the spec (name `admin`).
    It has no certificate and no management address.
    """
    first_contact: ManagementSpec | None = None
    """Second access besides `management`: a laptop on a port of the factory network; None: there is none."""

    @property
    def answering(self) -> tuple[str, ...]:
        """All addresses that respond to pings and ARP."""
        return tuple(dict.fromkeys((*self.neighbours, *self.around.cards)))

    @property
    def paths(self) -> tuple[ManagementSpec, ...]:
        """All management paths of the router, that of the inventory first."""
        return (self.management,) if self.first_contact is None else (self.management, self.first_contact)

    @model_validator(mode="after")
    def _check_ports(self) -> Self:
        there = {*self.ports, *(radio.name for radio in self.radios)}
        unknown = {*(path.port for path in self.paths), *self.poe_ports} - there
        if unknown:
            raise ValueError(f"no such port on {self.name}: {', '.join(sorted(unknown))}")
        return self


class EmulatorSpec(_Spec):
    """A router with the link to it and its adjustable behaviour."""

    router: RouterSpec
    link: RouterLink = RouterLink()
    knobs: WireBehaviour = WireBehaviour()
    ports: dict[int, int] = Field(default_factory=dict)
    """Preferred loopback ports by service port; the kernel chooses the others."""


class SiteSpec(_Spec):
    """All emulated routers of a site."""

    name: str
    emulators: tuple[EmulatorSpec, ...]
    pairs: tuple[RadioPair, ...] = ()
    """Radio links between routers of the site."""

    @model_validator(mode="after")
    def _check_radio_pairs(self) -> Self:
        radios = {emulator.router.name: [radio.name for radio in emulator.router.radios] for emulator in self.emulators}
        for pair in self.pairs:
            for name, radio in ((pair.near, pair.near_radio), (pair.far, pair.far_radio)):
                if radio not in radios.get(name, ()):
                    raise ValueError(f"there is no radio {radio} on a twin called {name}")
        return self

    @model_validator(mode="after")
    def _check_unique_names(self) -> Self:
        names = [emulator.router.name for emulator in self.emulators]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"two twins are called {', '.join(twice)}")
        return self
