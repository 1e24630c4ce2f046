"""The Linux computers of a site: gateway, control centre, operator station, VPN server.

`host_vars/<host>.yml`, key `device`.
"""

from __future__ import annotations

import base64
import re
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, StrictBool, StrictInt

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import _base
from atlantis_netcfg.inventory.model.services import HostedService, Recording, Ros1Bridge  # noqa: TC001 - pydantic reads them

REFLECTOR_PORT = 6862
"""UDP port at which gateways and control centres answer one another's checklists, in the VPN alone."""
_KINDS = (
    "ssh-ed25519",
    "sk-ssh-ed25519@openssh.com",
    "ecdsa-sha2-nistp256",
    "ecdsa-sha2-nistp384",
    "ecdsa-sha2-nistp521",
    "sk-ecdsa-sha2-nistp256@openssh.com",
    "ssh-rsa",
)
"""Of authorized_keys (sshd(8)); ssh-dss is refused by every server since OpenSSH 7.0."""


def _ssh_key(value: object) -> str:
    text = _base.plain(value)
    if "PRIVATE KEY" in text:
        raise _base.wrong("this is a private key", "remove it from the inventory, and use the content of its .pub file")
    kind, _, rest = text.partition(" ")
    body = rest.split(" ")[0]
    like = "copy the line of the technician's .pub file: kind, key, name"
    if kind not in _KINDS or not text.isprintable():
        raise _base.wrong("this is not a public SSH key that a server accepts", like)
    try:
        data = base64.b64decode(body, validate=True)
    except ValueError:
        raise _base.wrong("this public SSH key is damaged", like) from None
    size = int.from_bytes(data[:4], "big")
    if data[4 : 4 + size] != kind.encode() or len(data) < 4 + size + 4:
        raise _base.wrong("this public SSH key is damaged", like)
    return text


_KEY = rf"^({'|'.join(map(re.escape, _KINDS))}) [A-Za-z0-9+/]{{20,}}={{0,2}}( |$)"
SshKey = Annotated[str, BeforeValidator(_ssh_key), _base.text_like(_KEY)]
"""A public key as a line of authorized_keys, without options."""


def _interface(value: object) -> str:
    text = _base.plain(value)
    if not re.fullmatch(r"[a-z][a-z0-9]{0,14}", text):
        raise _base.wrong(
            msg(f"`{arg(text)}` is not the name of a network interface"),
            "`ip link` on the board shows it, for example eth0",
        )
    return text


def _receiver(value: object) -> str:
    text = _base.plain(value)
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9]{0,31}", text):
        raise _base.wrong(
            msg(f"`{arg(text)}` is not the name of a receiver"), "use a name below /dev, for example ttyACM0"
        )
    return text


def _network_file(value: object) -> str:
    text = _base.plain(value)
    place = r"/etc/(netplan|network|systemd/network|NetworkManager)(/[A-Za-z0-9._@-]+)+"
    if ".." in text or not re.fullmatch(place, text):
        hint = "write its full path, for example /etc/netplan/50-cloud-init.yaml"
        raise _base.wrong(msg(f"`{arg(text)}` is not a network configuration file"), hint)
    return text


_NETWORK_FILE = r"^/etc/(netplan|network|systemd/network|NetworkManager)(/[A-Za-z0-9._@-]+)+$"
Interface = Annotated[str, BeforeValidator(_interface), _base.text_like("^[a-z][a-z0-9]{0,14}$")]
NetworkFile = Annotated[str, BeforeValidator(_network_file), _base.text_like(_NETWORK_FILE)]


class ImageLayout(StrEnum):
    """How the vendor's image is laid out."""

    ODROID_N2 = "odroid-n2"
    PLAIN = "plain"


class AddressBy(StrEnum):
    """Source of the gateway's address."""

    STATIC = "static"
    DHCP = "dhcp"


class Image(_base.Model):
    """What `provision gateway image` puts into the vendor's image."""

    layout: ImageLayout
    """`plain`: x86, Raspberry-type boards; one ext4 partition."""
    address_by: AddressBy = AddressBy.STATIC
    """`static`: the device's `address`; `dhcp`: a reservation of the site's LAN gives it."""
    interface: Interface | None = None
    """Of the LAN; null: the one that the board has."""
    user: _base.Account = "root"
    """The account that technicians log in to; it must be in the image."""
    ssh_keys: tuple[SshKey, ...]
    """The technicians' public keys: at least one, for every password is removed."""
    source: _base.Text | None = None
    """Where the image was fetched, for people; nothing is fetched by the toolkit."""


class Ssh(_base.Model):
    """How the toolkit logs in: by key, as a technician does."""

    user: _base.Account | None = None
    """None: the account of the image, else root; any other becomes root by `sudo`."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)] = 22
    """Of its SSH server."""
    host_key: SshKey | None = None
    """Its public host key, like the line of its `/etc/ssh/ssh_host_ed25519_key.pub`; None: `known_hosts` has it."""


class NetworkTool(StrEnum):
    """What configures the network interfaces of the computer."""

    NETPLAN = "netplan"
    IFUPDOWN = "ifupdown"
    NETWORKD = "networkd"


class ComputerNetwork(_base.Model):
    """The interface of the LAN; its changes are rolled back automatically unless confirmed."""

    by: NetworkTool
    """What configures the interface on the computer."""
    interface: Interface
    """`ip link` on the board shows it, like eth0."""
    rollback_s: Annotated[StrictInt, Field(ge=5, le=900)] = 180
    """A change that no new session has confirmed for so long is undone, in seconds; a satellite is silent for 70 s."""
    replaces: tuple[NetworkFile, ...] = ()
    """Files on the computer that configure the same interface, like the vendor's; they go with the change."""


class GpsSource(StrEnum):
    """How gpsd or a driver hands the time to chrony."""

    SHM = "shm"
    SOCKET = "socket"


class GpsTime(_base.Model):
    """A GPS receiver that gives the gateway its time."""

    source: GpsSource
    """How the time is handed to chrony."""
    device: Annotated[str, BeforeValidator(_receiver), _base.text_like("^[A-Za-z][A-Za-z0-9]{0,31}$")] = "ttyACM0"
    """Name below /dev of the receiver; of `socket` it is part of the socket's name."""


class SshHost(_base.LanBox):
    """A computer that the toolkit logs in to by SSH."""

    ssh: Ssh = Ssh()

    @property
    def account(self) -> str:
        """The account by which the toolkit logs in."""
        return self.ssh.user or "root"


class VpnServer(SshHost):
    """Runs the OpenVPN server."""

    kind: Literal["vpn_server"]
    """What the device is: it decides which keys the block has."""


class SiteComputer(SshHost):
    """A computer whose network and VPN membership the toolkit configures."""

    image: Image | None = None
    """None: no card is made for it here."""
    network: ComputerNetwork | None = None
    """None: the network stays as the image has it."""

    @property
    def account(self) -> str:
        """The account by which the toolkit logs in."""
        return self.ssh.user or (self.image.user if self.image is not None else "root")


class OperatorStation(SiteComputer):
    """The computer of an operator's place: the toolkit manages only its network and its VPN membership."""

    kind: Literal["operator_station"]
    """What the device is: it decides which keys the block has."""


class ServerComputer(SiteComputer):
    """A computer whose whole base system the toolkit manages: name, time, SSH, firewall, journal, watchdog."""

    gps: GpsTime | None = None
    """None: time comes over the network."""
    watchdog_s: Annotated[StrictInt, Field(ge=5, le=900)] | None = None
    """The board starts anew when its system has hung for so long, in seconds; None: its watchdog is not used."""
    services: tuple[HostedService, ...] = ()
    """What partners run here: web pages, interfaces, a back end, a database."""
    ros1_bridge: Ros1Bridge | None = None
    """None: no topics of ROS 1 are bridged."""

    @property
    def has_ros2(self) -> bool:
        """Whether the pilot's ROS 2 is installed on it."""
        raise NotImplementedError

    @property
    def has_interop(self) -> bool:
        """Whether the pilot's interoperability library is built on it."""
        raise NotImplementedError


class GatewayAccessPoint(_base.WifiRadio):
    """A radio of the gateway that opens a network for vehicles that are stations; it is no part of the LAN."""

    interface: Interface
    """The radio: `iw dev` on the gateway lists them, like wlan3."""
    network: _base.Network
    """Of the stations, by DHCP: no other network of the pilot."""
    address: _base.Address
    """Of the gateway in it."""
    isolated: StrictBool = True
    """Stations do not reach one another through it."""
    vpn: StrictBool = False
    """Stations reach the server of the VPN by way of the gateway, and nothing else: its policy says who meets whom."""


class Gateway(ServerComputer):
    """The data gateway computer."""

    kind: Literal["gateway"]
    """What the device is: it decides which keys the block has."""
    access_point: GatewayAccessPoint | None = None
    """None: no radio of the gateway opens a network."""
    recording: Recording | None = None
    """None: nothing is recorded."""

    @property
    def has_ros2(self) -> bool:
        """True: gateways follow the settings in `gateways`."""
        return True

    @property
    def has_interop(self) -> bool:
        """True: gateways follow the settings in `gateways`."""
        return True


class ControlCentre(ServerComputer):
    """Runs the control centre's services."""

    kind: Literal["control_centre"]
    """What the device is: it decides which keys the block has."""
    ros2: StrictBool = False
    """Whether ROS 2 is installed, as `gateways.ros2` of the pilot declares it; the DDS profile is there in any case."""
    interop: StrictBool = False
    """Whether the library is built, as `gateways.interop` of the pilot declares it."""

    @property
    def has_ros2(self) -> bool:
        """By choice."""
        return self.ros2

    @property
    def has_interop(self) -> bool:
        """Whether the inventory selects ROS 2 for it."""
        return self.interop
