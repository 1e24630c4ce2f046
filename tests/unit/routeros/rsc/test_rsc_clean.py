"""No export in this repository holds a secret, or a datum of a person or of a device that exists."""

import re
from collections.abc import Iterator
from ipaddress import ip_address, ip_network
from pathlib import Path

import pytest
from row_subtests import for_each_row

TESTS = Path(__file__).parents[3]
FOLDERS = ("unit", "data", "integration")

RESERVED = tuple(
    ip_network(prefix)
    for prefix in (
        *("0.0.0.0/8", "10.0.0.0/8", "100.64.0.0/10", "127.0.0.0/8", "169.254.0.0/16", "172.16.0.0/12"),
        *("192.0.0.0/24", "192.0.2.0/24", "192.88.99.0/24", "192.168.0.0/16", "198.18.0.0/15", "198.51.100.0/24"),
        *("203.0.113.0/24", "224.0.0.0/3"),
    )
)
"""Private, special and documentation prefixes (RFC 1918, RFC 5737, RFC 6890): addresses of nobody."""
KNOWN_SERVERS = {"1.1.1.1", "8.8.8.8", "9.9.9.9"}
"""Resolvers that serve everybody."""
_ADDRESS = re.compile(r"(?<![\d.])(\d{1,3}(?:\.\d{1,3}){3})(?![\d.])")
_MAC = re.compile(r"(?<![0-9A-Fa-f:])[0-9A-Fa-f]{2}(?::[0-9A-Fa-f]{2}){5}(?![0-9A-Fa-f:])")
_OUR_MACS = re.compile(r"00:00:5E:00:53:..|[0-9A-F][26AE]:.*", re.IGNORECASE)
"""For documentation (RFC 7042), or locally administered: no device has it from its maker."""
_SECRET = re.compile(
    r"\b(?:password|passphrase|secret|[a-z0-9-]*(?:private|preshared|pre-shared)-key|pin|authentication-password)="
    r'(?!""|\s|$)(?:"([^"]*)"|(\S+))'
)
_EXAMPLE_SECRET = re.compile(r"(?:open sesame|not a secret|example|secret|x+)[\w -]*", re.IGNORECASE)
_MAIL = re.compile(r"[\w.+-]+@([\w-]+(?:\.[\w-]+)+)")
_DEVICE = re.compile(r"^# (?:software id|serial number) = (\S+)", re.MULTILINE)
_OUR_DEVICES = re.compile(r"(?:ABCD-1234|0A1B2C3D\w*|HGX0A1B2C3D|X+|.*EXAMPLE.*|0+)")
_DYNAMIC_NAME = re.compile(r"\b[0-9a-f]{8,}\.sn\.mynetname\.net\b")


def objections(text: str) -> Iterator[str]:
    """Yield what may be somebody's."""
    joined = re.sub(r"\\\r?\n *", "", text)
    for address in _ADDRESS.findall(joined):
        if address not in KNOWN_SERVERS and _is_public(address):
            yield f"address {address}"
    yield from (f"MAC {mac}" for mac in _MAC.findall(joined) if not _OUR_MACS.fullmatch(mac))
    for quoted, bare in _SECRET.findall(joined):
        if not _EXAMPLE_SECRET.fullmatch(quoted or bare):
            yield "secret"
    yield from (f"mail {domain}" for domain in _MAIL.findall(joined) if "example" not in domain)
    yield from (f"device {found}" for found in _DEVICE.findall(joined) if not _OUR_DEVICES.fullmatch(found))
    yield from (f"name {found}" for found in _DYNAMIC_NAME.findall(joined))


def _is_public(text: str) -> bool:
    try:
        address = ip_address(text)
    except ValueError:
        return False
    return not any(address in network for network in RESERVED)


MADE_UP = {
    "unit/routeros/planner/golden/rows.desired.rsc": {"secret"},
    "unit/routeros/planner/golden/rows.device.rsc": {"secret"},
    "unit/emulator/routeros/golden/seed.rsc": {"MAC 48:A9:8A:C5:3C:FE", "device 1E8B-F5B5"},
}
"""Reviewed: passwords of examples, and what a twin computes from its name."""
EXPORTS = sorted(path for folder in FOLDERS for path in (TESTS / folder).rglob("*.rsc"))


@for_each_row("path", EXPORTS, ids=lambda path: path.relative_to(TESTS).as_posix())
def test_exports_contain_no_personal_data(path: Path) -> None:
    found = set(objections(path.read_bytes().decode("utf-8", "surrogateescape")))
    assert found == MADE_UP.get(path.relative_to(TESTS).as_posix(), set())


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("add address=81.2.69.142/24 interface=ether1", ["address 81.2.69.142"]),
        ("add address=192.0.2.1/24 comment=1.2.3 interface=ether1", []),
        ("set mac-address=4C:5E:0C:11:22:33", ["MAC 4C:5E:0C:11:22:33"]),
        ("set mac-address=00:00:5E:00:53:01 admin-mac=02:00:00:00:00:01", []),
        ("add name=x password=hunter2", ["secret"]),
        ('add name=x password="" wpa2-pre-shared-key="a b"', ["secret"]),
        ("set passphrase=\\\n    hunter2hunter2", ["secret"]),
        ("set from=somebody@mikrotik.com", ["mail mikrotik.com"]),
        ("set from=somebody@example.org", []),
        ("# software id = QA4R-B09A\n# serial number = 661705E84C20", ["device QA4R-B09A", "device 661705E84C20"]),
        ("add address=a1b2c3d4e5f6.sn.mynetname.net", ["name a1b2c3d4e5f6.sn.mynetname.net"]),
        ("add dst-address=0.0.0.0/0 gateway=10.0.0.1 servers=9.9.9.9", []),
    ],
)
def test_possibly_personal_data_is_detected(text: str, found: list[str]) -> None:
    assert list(objections(text)) == found
