"""Base of all inventory models: strict validation, and value syntaxes.

Invalid values are refused with `wrong`, in a technician's wording; the validator adds file and line.

The module also has the common keys of a site's devices.
"""

from __future__ import annotations

import re
from datetime import date
from enum import StrEnum
from ipaddress import IPv4Address, IPv4Network
from typing import Annotated, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    StrictBool,
    StrictInt,
    WithJsonSchema,
)
from pydantic_core import PydanticCustomError

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import MASK, Secret
from atlantis_netcfg.inventory.findings import why_no_name

WRONG = "atlantis"
"""Error type of a value that one of the types below refuses; its context holds `what` and `hint`."""
NOT_TEXT = "atlantis_not_text"
"""Error type of a value that YAML did not read as text."""
_PREFIX_MAX = 32
_SSID_BYTES = 32


class Model(BaseModel):
    """A part of the inventory: unknown keys are errors, values never change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True, allow_inf_nan=False)


def wrong(what: str, hint: str) -> PydanticCustomError:
    """Build an error with our own text: what is wrong, and what to type instead."""
    return PydanticCustomError(WRONG, "{what}", {"what": what, "hint": hint})


def plain(value: object) -> str:
    """Return a text without surrounding blanks; other types are refused by name."""
    if not isinstance(value, str):
        raise PydanticCustomError(NOT_TEXT, "not text")
    return value.strip()


def _line(value: object) -> str:
    text = plain(value)
    if not text:
        raise wrong("the text is missing", "write a word or two")
    if not text.isprintable():
        raise wrong("the text contains a line break or another control character", "write it on one line")
    return text


def _port(value: object) -> str:
    text = plain(value)
    if not re.fullmatch(r"(ether|sfp|sfp-sfpplus|qsfpplus|combo)[0-9]+(-[0-9]+)?", text):
        raise wrong(
            msg(f"`{arg(text)}` is not a port of a RouterOS device"),
            "a port has its factory name, for example ether1 or sfp1",
        )
    return text


def _account(value: object) -> str:
    text = plain(value)
    if not re.fullmatch(r"[a-z_][a-z0-9_-]{0,31}", text):
        raise wrong(
            msg(f"`{arg(text)}` is not a valid account name"), "an account name is, for example, root or odroid"
        )
    return text


def _secret(value: object) -> Secret:
    if isinstance(value, Secret):
        return value
    text = plain(value)
    if not text:
        raise wrong("the secret is empty", "write the secret, or EXAMPLE-… until there is one")
    return Secret(text)


def _address(value: object) -> IPv4Address:
    if isinstance(value, IPv4Address):
        return value
    text = plain(value)
    try:
        return IPv4Address(text)
    except ValueError:
        raise wrong(*_why_no_address(text)) from None


def _why_no_address(text: str) -> tuple[str, str]:
    like = "an address is four numbers from 0 to 255, for example 10.64.1.1"
    if "/" in text:
        return msg(f"`{arg(text)}` has a prefix length: a single address is expected here"), text.partition("/")[
            0
        ] or like
    if ":" in text:
        return msg(f"`{arg(text)}` is not an IPv4 address: the address plan is IPv4 only"), like
    if re.fullmatch(r"\d+(\.\d+){3}", text):
        if too_large := [part for part in text.split(".") if len(part) > 3 or int(part) > 255]:  # noqa: PLR2004
            return msg(f"`{arg(text)}` is not an IPv4 address: {arg(too_large[0])} is more than 255"), like
        clean = ".".join(str(int(part)) for part in text.split("."))
        return msg(f"`{arg(text)}` is not an IPv4 address: one of its numbers starts with 0"), clean
    return msg(f"`{arg(text)}` is not an IPv4 address"), like


def _network(value: object) -> IPv4Network:
    if isinstance(value, IPv4Network):
        return value
    text = plain(value)
    address, slash, prefix = text.partition("/")
    try:
        IPv4Address(address)
    except ValueError:
        raise wrong(*_why_no_network(text, address)) from None
    if not slash:
        raise wrong(msg(f"`{arg(text)}` has no prefix length: a network is expected here"), f"{text}/24")
    if not re.fullmatch(r"\d{1,2}", prefix) or int(prefix) > _PREFIX_MAX:
        raise wrong(msg(f"`{arg(text)}`: the prefix length is a number from 0 to 32"), f"{address}/24")
    network = IPv4Network(f"{address}/{int(prefix)}", strict=False)
    if str(network.network_address) != address:
        raise wrong(msg(f"`{arg(text)}` is not the first address of its network"), str(network))
    return network


def _why_no_network(text: str, address: str) -> tuple[str, str]:
    what, _ = _why_no_address(address)
    return what.replace(f"`{address}`", f"`{text}`").replace(
        "address:", "network:"
    ), "example of a network: 10.64.1.0/24"


def _mac(value: object) -> str:
    text = plain(value)
    pairs = re.sub(r"[^0-9A-Fa-f]", "", text)
    if not re.fullmatch(r"(?:[0-9A-Fa-f]{2}:){5}[0-9A-Fa-f]{2}", text):
        whole = re.fullmatch(r"[0-9A-Fa-f]{12}", pairs) and re.fullmatch(r"[0-9A-Fa-f.: -]+", text)
        right = ":".join(pairs[i : i + 2] for i in range(0, 12, 2)).upper() if whole else "02:00:5E:00:01:10"
        raise wrong(msg(f"`{arg(text)}` is not a MAC address"), msg(f'write six pairs of hex digits: "{arg(right)}"'))
    if int(text[:2], 16) & 1:
        raise wrong(
            msg(f"`{arg(text)}` is a multicast MAC address"), "read it from the device: its second digit is even"
        )
    return text.upper()


def _name(value: object) -> str:
    text = plain(value)
    if why := why_no_name(text):
        raise wrong(*why)
    return text


def _dns_name(value: object) -> str:
    text = plain(value)
    label = r"[A-Za-z0-9](?:[A-Za-z0-9-]{0,61}[A-Za-z0-9])?"
    if not re.fullmatch(rf"{label}(?:\.{label})*", text) or len(text) > 253:  # noqa: PLR2004 - RFC 1035, 2.3.4
        raise wrong(msg(f"`{arg(text)}` is not a DNS name"), "example of a DNS name: vpn.example.org")
    return text


def _sha256(value: object) -> str:
    text = plain(value).lower()
    if not re.fullmatch(r"[0-9a-f]{64}", text):
        raise wrong(msg(f"`{arg(text)}` is not a SHA-256 (64 hex digits)"), "copy the output of `sha256sum FILE`")
    return text


def _fingerprint(value: object) -> str:
    text = plain(value).replace(":", "").lower()
    if not re.fullmatch(r"[0-9a-f]{64}", text):
        raise wrong(
            msg(f"`{arg(value)}` is not a certificate fingerprint (SHA-256, 64 hex digits)"),
            "copy `fingerprint` of  /certificate print detail  on the device",
        )
    return text


def _host_key(value: object) -> str:
    text = plain(value)
    if not re.fullmatch(r"SHA256:[A-Za-z0-9+/]{43}", text):
        raise wrong(
            msg(f"`{arg(text)}` is not the fingerprint of an SSH host key"),
            "copy the output of `ssh-keygen -l`: SHA256:…",
        )
    return text


def _day(value: object) -> str:
    text = value.isoformat() if type(value) is date else plain(value)
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        raise wrong(
            msg(f"`{arg(text)}` is not a date"), 'write year, month and day in quotes, for example "2026-11-21"'
        ) from None


def _currency(value: object) -> str:
    text = plain(value)
    if not re.fullmatch(r"[A-Z]{3}", text):
        raise wrong(msg(f"`{arg(text)}` is not a currency"), "write three capital letters, for example EUR (ISO 4217)")
    return text


def _ssid(value: object) -> str:
    text = plain(value)
    if not text or len(text.encode()) > _SSID_BYTES:
        raise wrong(
            msg(f"an SSID has 1 to {arg(_SSID_BYTES)} bytes, this one has {arg(len(text.encode()))}"),
            "choose a shorter one",
        )
    return text


def text_like(pattern: str, **more: int) -> WithJsonSchema:
    """Return the editor schema of a text: only its form, since the validator checks the rest."""
    return WithJsonSchema({"type": "string", "pattern": pattern, **more})


_BYTE = "(25[0-5]|2[0-4][0-9]|1[0-9][0-9]|[1-9]?[0-9])"
_IPV4 = rf"{_BYTE}(\.{_BYTE}){{3}}"
_LABEL = "[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?"
_OUR_NAME = "^[a-z0-9]([a-z0-9-]{0,30}[a-z0-9])?$"

Address = Annotated[IPv4Address, BeforeValidator(_address), text_like(f"^{_IPV4}$")]
Network = Annotated[IPv4Network, BeforeValidator(_network), text_like(f"^{_IPV4}/(3[0-2]|[0-2]?[0-9])$")]
MacAddress = Annotated[str, BeforeValidator(_mac), text_like("^[0-9A-Fa-f][02468ACEace](:[0-9A-Fa-f]{2}){5}$")]
"""An EUI-48 address, upper case, as RouterOS prints it."""
Name = Annotated[str, BeforeValidator(_name), text_like(_OUR_NAME)]
"""A name of ours (site, link, vehicle): an RFC 1123 label of at most 32 characters."""
HostName = Annotated[str, BeforeValidator(_name), text_like(_OUR_NAME)]
"""The inventory's name of a host."""
DnsName = Annotated[str, BeforeValidator(_dns_name), text_like(rf"^{_LABEL}(\.{_LABEL})*$", maxLength=253)]
PortName = Annotated[str, BeforeValidator(_port), text_like("^(ether|sfp|sfp-sfpplus|qsfpplus|combo)[0-9]+(-[0-9]+)?$")]
"""The factory name of a port (`default-name`)."""
Sha256 = Annotated[str, BeforeValidator(_sha256), text_like("^[0-9A-Fa-f]{64}$")]
"""Of a file, in hex."""
Fingerprint = Annotated[str, BeforeValidator(_fingerprint), text_like("^(:*[0-9A-Fa-f]){64}$")]
"""SHA-256 of a certificate, in hex."""
HostKey = Annotated[str, BeforeValidator(_host_key), text_like("^SHA256:[A-Za-z0-9+/]{43}$")]
"""SHA-256 of an SSH host key, as `ssh-keygen -l` prints it."""
Day = Annotated[str, BeforeValidator(_day), text_like("^[0-9]{4}-[0-9]{2}-[0-9]{2}$")]
"""As ISO 8601 has it."""
Currency = Annotated[str, BeforeValidator(_currency), text_like("^[A-Z]{3}$")]
"""ISO 4217."""
Text = Annotated[str, BeforeValidator(_line), text_like(r"^[^\x00-\x1f\x7f]*[^\s\x00-\x1f\x7f][^\x00-\x1f\x7f]*$")]
"""One line for people."""
Ssid = Annotated[str, BeforeValidator(_ssid), text_like(r"\S", maxLength=_SSID_BYTES)]
"""At most 32 bytes (IEEE 802.11), which is fewer characters if they are not ASCII."""
Account = Annotated[str, BeforeValidator(_account), text_like("^[a-z_][a-z0-9_-]{0,31}$")]
SecretText = Annotated[
    Secret,
    BeforeValidator(_secret),
    PlainSerializer(lambda _: MASK, return_type=str),
    text_like(r"^(EXAMPLE-|\$ANSIBLE_VAULT;)"),
]
"""Vaulted, or an example; an editor sees the text behind `!vault`."""


class PowerSource(Model):
    """The PoE port that feeds a device."""

    device: HostName
    """The router or a switch of the same site."""
    port: PortName
    """A port of it that has `poe`."""


class Box(Model):
    """What every box has."""

    model: Text | None = None
    """What is printed on it; null until the partner has told."""
    mac: MacAddress | None = None
    """Of its network card."""
    powered_by: PowerSource | None = None
    """None if it has a supply of its own."""


class LanBox(Box):
    """A host of the site's LAN."""

    address: Address
    """In the site's LAN."""
    vpn_address: Address | None = None
    """Its tunnel address in the infrastructure's pool; None: it is no member of the VPN."""


class Access(Model):
    """How the toolkit reaches a RouterOS device."""

    address: Address
    """A router's on its management port, a switch's in the LAN, a CPE's in the network of its link."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)] = 8729
    """Of service `api-ssl`."""
    user: Text = "provision"
    """In group `full`."""
    password: SecretText
    """Vaulted, or EXAMPLE-…."""
    fingerprint: Fingerprint | None = None
    """Of its certificate; None: only this computer knows it: `provision device adopt` or `provision device trust`."""
    host_key: HostKey | None = None
    """Of its SSH server; None: it is known on this computer alone, by `provision device adopt`."""
    via: Name = "lan"
    """`lan` from the management port, or the bearer over which the technician works."""


class Transport(StrEnum):
    """What carries the tunnel."""

    UDP = "udp"
    TCP = "tcp"


Country = Literal[  # noqa: RUF041 - flat, it is formatted as 30 lines
    Literal["later"],
    Literal["portugal", "belgium", "austria", "bulgaria", "croatia", "cyprus", "denmark"],
    Literal["estonia", "finland", "france", "germany", "greece", "hungary", "iceland"],
    Literal["ireland", "italy", "latvia", "lithuania", "luxembourg", "malta", "netherlands"],
    Literal["norway", "poland", "romania", "slovakia", "slovenia", "spain", "sweden"],
    Literal["switzerland"],
]
"""Country with known radio rules, by its name in RouterOS; `later`: a rehearsal does not need one."""


class WifiRadio(Model):
    """Settings of a radio that others join."""

    ssid: Ssid
    """Name of the radio network, the same at every end."""
    standard: Literal["802.11a", "802.11g", "802.11n", "802.11ac", "802.11ax"]
    """Of the radio cards; every end has it."""
    band: Literal["2ghz", "5ghz"]
    """2.4 or 5 GHz."""
    frequency_mhz: StrictInt
    """Centre of the channel, in MHz; it must be one that the country allows."""
    width_mhz: Literal[20, 40, 80] = 20
    """Of the channel, in MHz."""
    country: Country
    """Regulatory domain, the one of the pilot."""
    outdoor: StrictBool = True
    """Whether the antennas stand outdoors: some channels are for indoors only."""
    key: SecretText
    """Passphrase of the network, the same at every end. Vaulted, or EXAMPLE-…."""
    wpa: Literal["wpa2", "wpa3"] = "wpa2"
    """With protocol 802.11; wpa3 exists in the `wifi` menus only."""
    tx_power_dbm: Annotated[StrictInt, Field(ge=0, le=40)] | None = None
    """At the antenna's socket; None leaves it to the country's limit, which is too much for a short link."""
    antenna_gain_dbi: Annotated[StrictInt, Field(ge=0, le=30)] | None = None
    """From the antenna's data sheet; with it the radiated power is held below the country's limit.

    RouterOS' `wifi` menus take 30 at most.
    """
