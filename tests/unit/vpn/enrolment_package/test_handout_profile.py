"""Profiles: the words of each kind of member, and identities that are read back or refused."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from handout_mint import Wanted, identity

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.vpn.enrolment_package.profile import NotAnIdentity, identity_file, profile, read_identity
from atlantis_netcfg.vpn.identity import KeyType, MemberKind, MemberLink, Wrap


@pytest.fixture(scope="module")
def declaration() -> Inventory:
    return load(Path(__file__).parents[4] / "inventory")


def options(text: Secret) -> list[str]:
    """Lines of the profile that OpenVPN obeys, blocks aside."""
    lines = text.reveal().partition("\n<ca>\n")[0].splitlines()
    return [line for line in lines if not line.startswith("#")]


"""What a server may push in vain."""


def test_laptop_profile_has_the_expected_options(declaration: Inventory) -> None:
    assert options(profile(declaration, identity())) == [
        "client",
        "proto udp4",
        "remote 203.0.113.2 1194",
        "dev tun",
        "dev-type tun",
        "nobind",
        "persist-key",
        "persist-tun",
        "remote-cert-tls server",
        "verify-x509-name scc-vpn name",
        "tls-version-min 1.2",
        "data-ciphers AES-256-GCM:CHACHA20-POLY1305:AES-128-GCM",
        *(
            f'pull-filter ignore "{word}"'
            for word in ("route ", "route-ipv6 ", "redirect-", "dhcp-option ", "ifconfig-ipv6 ")
        ),
        "connect-retry 5 300",
        "reneg-sec 86400",
        "verb 3",
    ]


@pytest.mark.parametrize(
    ("wanted", "added", "gone"),
    [
        (Wanted(kind=MemberKind.ROBOT), {"auth-retry nointeract", "auth-nocache"}, set()),
        (
            Wanted(link=MemberLink.SATELLITE),
            {"tls-timeout 8", "hand-window 120", "connect-retry 5 900"},
            {"connect-retry 5 300"},
        ),
        (
            Wanted(wrap=Wrap.TLS_CRYPT),
            {"ncp-ciphers AES-256-GCM:AES-128-GCM"},
            {"data-ciphers AES-256-GCM:CHACHA20-POLY1305:AES-128-GCM"},
        ),
        (
            Wanted("coastal-gateway", MemberKind.HOST, None, "10.80.0.12"),
            {"dev tun0", "auth-retry nointeract", "auth-nocache"},
            {"dev tun"},
        ),
        (
            Wanted("scc-control", MemberKind.HOST, None, "10.80.0.2"),
            {"remote 10.64.0.10 1194", "dev tun0", "auth-retry nointeract", "auth-nocache"},
            {"remote 203.0.113.2 1194", "dev tun"},
        ),
    ],
    ids=["robot", "satellite", "client of 2.4", "gateway", "host of the server's site"],
)
def test_profile_options_that_differ_by_request(
    declaration: Inventory, wanted: Wanted, added: set[str], gone: set[str]
) -> None:
    plain, other = (set(options(profile(declaration, identity(one)))) for one in (Wanted(), wanted))
    assert (other - plain, plain - other) == (added, gone)


def test_profile_over_tcp(declaration: Inventory) -> None:
    vpn = declaration.pilot.vpn.model_copy(update={"transport": "tcp", "port": 443})
    other = replace(declaration, pilot=declaration.pilot.model_copy(update={"vpn": vpn}))
    assert {"proto tcp4-client", "remote 203.0.113.2 443"} <= set(options(profile(other, identity())))


EVERY = [
    Wanted(),
    Wanted(key=KeyType.RSA, wrap=Wrap.TLS_CRYPT),
    Wanted("udg-sparus2", MemberKind.ROBOT, "udg", vehicle="sparus", link=MemberLink.SATELLITE, generation=2),
    Wanted("coastal-gateway", MemberKind.HOST, None),
]


@pytest.mark.parametrize("wanted", EVERY, ids=lambda wanted: wanted.name)
def test_identity_can_be_read_back(declaration: Inventory, wanted: Wanted) -> None:
    """From the file of a host and from a profile, also one that Windows has had in its hands."""
    told = identity(wanted)
    for text in (identity_file(told), profile(declaration, told)):
        assert read_identity(text.reveal()) == told
        assert read_identity(text.reveal().replace("\n", "\r\n")) == told


@pytest.mark.parametrize("wanted", EVERY, ids=lambda wanted: wanted.name)
def test_no_line_is_too_long_for_openvpn_2_4(declaration: Inventory, wanted: Wanted) -> None:
    assert max(map(len, profile(declaration, identity(wanted)).reveal().splitlines())) < 255


MISFITS: dict[str, tuple[Callable[[str], str], str]] = {
    "another text": (lambda _: "client\n", "the line `# atlantis-identity 1` is missing"),
    "two of them": (lambda text: text + text, "the line `# atlantis-identity 1` is missing"),
    "cut": (lambda text: text[: len(text) // 2], "it contains the block <cert> 0 times"),
    "a line gone": (lambda text: text.replace("# link: fibre\n", ""), "its header is incomplete"),
    "unknown kind": (lambda text: text.replace("kind: laptop", "kind: toaster"), "it contains an invalid value"),
    "no address": (lambda text: text.replace("10.80.16.1", "10.80.16"), "it contains an invalid value"),
    "unknown wrap": (
        lambda text: text.replace("wrap: tls-crypt-v2", "wrap: none"),
        "the protection of its control channel is unknown",
    ),
    "another's name": (
        lambda text: text.replace("inesc-laptop1", "inesc-laptop2"),
        "the name in its certificate differs from the one in its header",
    ),
    "another's key": (
        lambda text: text.replace(identity_key(text), identity_key(identity_file(identity()).reveal())),
        "its key does not match its certificate",
    ),
    "endless": (lambda text: text + " " * 65536, "it has more than 65536 characters"),
}


def identity_key(text: str) -> str:
    return text.partition("<key>\n")[2].partition("</key>")[0]


@pytest.mark.parametrize("case", MISFITS)
def test_invalid_identity_is_refused(case: str) -> None:
    spoil, why = MISFITS[case]
    text = identity_file(identity()).reveal()
    with pytest.raises(NotAnIdentity) as refused:
        read_identity(spoil(text))
    assert str(refused.value) == f"not a VPN identity: {why}"
    assert "PRIVATE" not in repr(refused.value) + repr(refused.value.__cause__)


def test_certificate_of_another_ca_is_refused() -> None:
    told = identity()
    with pytest.raises(NotAnIdentity, match="its certificate was issued by another CA"):
        read_identity(identity_file(replace(told, ca=told.cert)).reveal())
