"""Value types for addresses, prefixes, ranges, ports, and references to rows of other menus."""

from __future__ import annotations

import re
from dataclasses import dataclass
from ipaddress import (
    AddressValueError,
    IPv4Address,
    IPv4Interface,
    IPv4Network,
    NetmaskValueError,
    ip_address,
    ip_network,
)

from atlantis_netcfg.emulator.routeros.values import _plain

_HOST_NAME = re.compile(r"(?=.{1,253}$)[A-Za-z0-9_]([A-Za-z0-9_-]{0,62})(\.[A-Za-z0-9_-]{1,63})*\.?")
_SHORT = re.compile(r"(?<![\w.:/-])(\d{1,3}(?:\.\d{1,3})?)\.(\d{1,3})(?![\w.:/-])")
_LAST_PORT = 65535
_WHOLE = 32


def expand(text: str) -> str:
    """Expand short IPv4 forms as the console does: `2.2` (2.0.0.2), `2.1.1` (2.1.0.1), also in lists and ranges."""
    return _SHORT.sub(lambda match: f"{match[1]}{'.0' * (2 - match[1].count('.'))}.{match[2]}", text)


def _address(text: str, *, v6: bool = True) -> str:
    try:
        return str(ip_address(text) if v6 else IPv4Address(text))
    except ValueError as error:
        raise _plain.BadValue from error


@dataclass(frozen=True, slots=True)
class Address(_plain.ValueType):
    """An IP address; `dns`: or a DNS name; `v6=False`: only IPv4; `empty`: or nothing."""

    v6: bool = True
    dns: bool = False
    empty: bool = False
    words: tuple[str, ...] = ()

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Normalise the address."""
        if (not text and self.empty) or text in self.words:
            return text
        looks_numeric = re.fullmatch(r"[\d.]+", text)
        if self.dns and not looks_numeric and _HOST_NAME.fullmatch(text):
            return text
        return _address(text, v6=self.v6)

    def normalise(self, text: str) -> str:
        """Expand short forms."""
        return expand(text)


@dataclass(frozen=True, slots=True)
class AddressesValue(_plain.ValueType):
    """A list of addresses, possibly empty."""

    element: Address = Address()

    def parse(self, text: str, names: _plain.NamesValue) -> str:
        """Normalise each address."""
        return ",".join(self.element.parse(part, names) for part in text.split(",")) if text else ""


@dataclass(frozen=True, slots=True)
class HostPrefix(_plain.ValueType):
    """An address with prefix length, `10.0.0.1/24`; without one it is a /32."""

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Parse `10.0.0.1/24` and `10.0.0.1/255.255.255.0`."""
        try:
            return str(IPv4Interface(text))
        except (AddressValueError, NetmaskValueError) as error:
            raise _plain.BadValue from error

    def code(self, text: str) -> str:
        """Append the placeholder for the missing length."""
        return f"{text};"

    def export(self, value: str) -> str:
        """Omit a /32, as the exports of many routers do."""
        return value.removesuffix(f"/{_WHOLE}")

    def normalise(self, text: str) -> str:
        """Expand short forms."""
        return expand(text)


@dataclass(frozen=True, slots=True)
class Prefixes(_plain.ValueType):
    """A network, or with `many` a list; host bits are cleared as in RouterOS. A single address is a /32."""

    many: bool = False
    v6: bool = True
    empty: str | None = None
    """Meaning of an empty text; None: it is rejected."""

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Normalise each network."""
        text = text if text or self.empty is None else self.empty
        parts = text.split(",") if self.many and text else [text] if text or not self.many else []
        return ",".join(map(self._network, parts))

    def _network(self, text: str) -> str:
        try:
            return str(ip_network(text, strict=False) if self.v6 else IPv4Network(text, strict=False))
        except ValueError as error:
            raise _plain.BadValue from error


def _range(text: str) -> str:
    first, dash, last = text.partition("-")
    if dash:
        if not last:
            raise _plain.BadValue("value of range must have ip address after '-'")
        low, high = _address(first, v6=False), _address(last, v6=False)
        if IPv4Address(low) > IPv4Address(high):
            raise _plain.BadValue
        return f"{low}-{high}"
    try:
        network = IPv4Network(text, strict=False)
    except ValueError as error:
        raise _plain.BadValue from error
    return str(network.network_address) if network.prefixlen == _WHOLE else str(network)


@dataclass(frozen=True, slots=True)
class Matcher(_plain.ValueType):
    """Value of a matcher or address list: IPv4 address, network or range; `dns`: or a DNS name."""

    dns: bool = False

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Normalise the value; a /32 is printed as an address."""
        if self.dns and re.search(r"[A-Za-z]", text) and _HOST_NAME.fullmatch(text):
            return text
        return _range(text)

    def code(self, text: str) -> str:
        """Prepend the placeholder for the missing sign."""
        return f";{text}"

    def normalise(self, text: str) -> str:
        """Expand short forms."""
        return expand(text)


@dataclass(frozen=True, slots=True)
class Ranges(_plain.ValueType):
    """The ranges of a pool, separated by commas."""

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Normalise each range."""
        return ",".join(map(_range, text.split(",")))


@dataclass(frozen=True, slots=True)
class Mac(_plain.ValueType):
    """A MAC address, printed in capitals with colons."""

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Accept `:`, `-` and `.` between the bytes."""
        if not re.fullmatch(r"[0-9A-Fa-f]{2}(?:([:.-])[0-9A-Fa-f]{2})(?:\1[0-9A-Fa-f]{2}){4}", text):
            raise _plain.BadValue
        return re.sub(r"[.-]", ":", text).upper()


@dataclass(frozen=True, slots=True)
class Ports(_plain.ValueType):
    """Ports and ranges of ports: `80,443,1000-2000`; `single`: one port or range only."""

    single: bool = False

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Check every number."""
        parts = text.split(",")
        if self.single and len(parts) > 1:
            raise _plain.BadValue
        return ",".join(map(self._ports, parts))

    @staticmethod
    def _ports(text: str) -> str:
        match = re.fullmatch(r"(\d+)(?:-(\d+))?", text)
        if match is None:
            raise _plain.BadValue
        low, high = int(match[1]), int(match[2] or match[1])
        if not low <= high <= _LAST_PORT:
            raise _plain.BadValue
        return str(low) if match[2] is None else f"{low}-{high}"


_QUAD = re.compile(r"\d+(?:\.\d+){3}(?:/\d+)?")


@dataclass(frozen=True, slots=True)
class Plausible(_plain.ValueType):
    """A text that is only checked where it looks like an IPv4 address, or with `ports` like a port."""

    ports: bool = False

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Check every part that looks like an address or port; other parts are accepted."""
        for part in re.split("[,-]", text.removeprefix("!")):
            if self.ports and part.isdecimal() and int(part) > _LAST_PORT:
                raise _plain.BadValue
            if not self.ports and _QUAD.fullmatch(part):
                _range(part)
        return text


@dataclass(frozen=True, slots=True)
class GatewayValue(_plain.ValueType):
    """A next hop: address, interface, or both (`10.0.0.1%ether1`), optionally in a VRF (`10.0.0.1@main`)."""

    def parse(self, text: str, names: _plain.NamesValue) -> str:
        """Convert interfaces and VRFs to references; a black hole's hop may be empty (`commands/_checks.py`)."""
        if not text:
            return ""
        hop, at, vrf = text.partition("@")
        if at and (number := names.id_of("table", vrf)) is not None:
            return self._parse_gateway(hop, names) + "@" + _plain.reference("table", number)
        if at:
            raise _plain.BadValue
        return self._parse_gateway(hop, names)

    @staticmethod
    def _parse_gateway(text: str, names: _plain.NamesValue) -> str:
        address, percent, interface = text.partition("%")
        if not percent:
            try:
                return str(ip_address(address))
            except ValueError:
                address, interface = "", text
        number = names.id_of("interface", interface)
        if number is None:
            raise _plain.BadValue(_plain.NOT_OFFERED if percent or not interface[:1].isdecimal() else _plain.INVALID)
        host = _address(address) + "%" if percent else ""
        return host + _plain.reference("interface", number)


@dataclass(frozen=True, slots=True)
class Ref(_plain.ValueType):
    """Reference to a row of a name space by name or `*ID`, or one of `words`."""

    spaces: tuple[str, ...]
    words: tuple[str, ...] = ()

    def parse(self, text: str, names: _plain.NamesValue) -> str:
        """Return the reference to the row, or one of `words`."""
        if text in self.words:
            return text
        for space in self.spaces:
            number = _resolve_row_id(text, space, names)
            if number is not None:
                return _plain.reference(space, number)
        raise _plain.BadValue(_plain.NOT_OFFERED)


def _resolve_row_id(text: str, space: str, names: _plain.NamesValue) -> int | None:
    by_id = re.fullmatch(r"\*([0-9A-Fa-f]+)", text)
    if by_id is None:
        return names.id_of(space, text)
    number = int(by_id[1], 16)
    return None if names.name_of(space, number) is None else number


@dataclass(frozen=True, slots=True)
class Refs(_plain.ValueType):
    """A list of references to rows of one name space, possibly empty, separated by `between`."""

    element: Ref
    between: str = ","

    def parse(self, text: str, names: _plain.NamesValue) -> str:
        """Convert each name to a reference."""
        return self.between.join(self.element.parse(part, names) for part in text.split(self.between)) if text else ""


@dataclass(frozen=True, slots=True)
class Topics(_plain.ValueType):
    """Keywords of a fixed set, each with an optional `!`, in the given order."""

    words: tuple[str, ...]

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Accept only the fixed keywords."""
        for part in text.split(","):
            if part.removeprefix("!") not in self.words:
                raise _plain.BadValue(_plain.NOT_OFFERED)
        return text


@dataclass(frozen=True, slots=True)
class PolicySet(_plain.ValueType):
    """A set printed completely: members, then non-members with `!` (`policy` of a user group)."""

    words: tuple[str, ...]

    def parse(self, text: str, names: _plain.NamesValue) -> str:  # noqa: ARG002
        """Accept the fixed keywords; unnamed ones are not granted."""
        parts = text.split(",") if text else []
        if any(part.removeprefix("!") not in self.words for part in parts):
            raise _plain.BadValue(_plain.NOT_OFFERED)
        inside = [word for word in self.words if word in parts]
        return ",".join([*inside, *(f"!{word}" for word in self.words if word not in parts)])
