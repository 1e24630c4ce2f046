"""What is said about a name that is not taken, and to whom names belong."""

from pathlib import Path

import pytest
from authority_stand import POOL, stand, wish

from atlantis_netcfg.vpn.authority.model import EnrolmentRequest
from atlantis_netcfg.vpn.identity import MemberKind
from atlantis_netcfg.vpn.names import (
    LONGEST,
    RESERVED_WORDS,
    InvalidNameError,
    NameTaken,
    check_free,
    check_name,
    member_name,
)

LIKE = "a name has a to z, 0 to 9 and `-` between them, like sparus2"
SAID = [
    ("", "device `` is empty", LIKE),
    ("Sparus2", "device `Sparus2` has capital letters: names are written small", "device=sparus2, for instance"),
    ("sparus 2", "device `sparus 2` has a space in it", "device=sparus-2, for instance"),
    ("sparus_2", "device `sparus_2` has a `_` in it: write `-`", "device=sparus-2, for instance"),
    ("sparus2\n", "device `sparus2\\n` has a line break at its end", "device=sparus2, for instance"),
    (
        "sp\0arus",
        "device `sp\\x00arus` has a NUL in it: what comes after it is not read by everybody",
        "device=sp-arus, for instance",
    ),
    ("../ca", "device `../ca` has a `/` in it, which leads to another folder", "device=ca, for instance"),
    ("..", "device `..` has a dot in it", LIKE),
    ("-rf", "device `-rf` begins with `-`, as options do", "device=rf, for instance"),
    ("rf-", "device `rf-` ends with `-`", "device=rf, for instance"),
    (
        "iqu\u0430",
        "device `iqu\\u0430` has CYRILLIC SMALL LETTER A in it: letters are a to z without accents",
        "device=iqu, for instance",
    ),
    (
        "pe\u00f1a",
        "device `pe\\xf1a` has LATIN SMALL LETTER N WITH TILDE in it: letters are a to z without accents",
        "device=pena, for instance",
    ),
    ("a;b", "device `a;b` has `;` in it: names have a to z, 0 to 9, and `-` between them", "device=a-b, for instance"),
    ("a" * 49, f"device `{'a' * 49}` has 49 characters: 48 at most", f"device={'a' * 48}, for instance"),
    ("log", "device `log` is a reserved word of OpenVPN or nft", "device=log-1, for instance"),
    ("LOG", "device `LOG` has capital letters: names are written small", LIKE),
]


@pytest.mark.parametrize(("text", "message", "hint"), SAID, ids=lambda value: ascii(value)[:20])
def test_invalid_name_is_refused_with_a_suggestion(text: str, message: str, hint: str) -> None:
    with pytest.raises(InvalidNameError) as refused:
        check_name(text, "device")
    assert (str(refused.value), refused.value.hint) == (message, hint)


@pytest.mark.parametrize("word", ["default", "server", "ip", "ip6", "tcp", "udp", "log", "set", "map", "fwd", "dup"])
def test_openvpn_and_nft_keywords_are_reserved(word: str) -> None:
    assert word in RESERVED_WORDS


def test_partner_and_device_share_the_length_limit() -> None:
    assert len(member_name("inesc", "a" * 42)) == LONGEST
    with pytest.raises(InvalidNameError, match="has 49 characters: partner and device have 48 together") as refused:
        member_name("inesc", "a" * 43)
    assert refused.value.hint == f"device={'a' * 42}, for instance"
    with pytest.raises(InvalidNameError) as refused:
        member_name("a" * 48, "b")
    assert refused.value.hint == "take a shorter key for the partner"


def test_ambiguous_combined_name_is_taken(tmp_path: Path) -> None:
    made = stand(tmp_path)
    with made.signing() as signer:
        signer.issue([wish("b-c", "a")], made.deliver)
        with pytest.raises(NameTaken, match=r"`a-b-c` is the name of device `b-c` of partner `a`"):
            signer.issue([wish("c", "a-b")], made.deliver)
        with pytest.raises(NameTaken, match="is the name of device"):
            signer.issue([EnrolmentRequest("a-b-c", MemberKind.HOST, None, "a-b-c", pool=POOL)], made.deliver)
        signer.revoke(["a-b-c"], "lost")
        with pytest.raises(NameTaken, match="is the name of device"):
            signer.issue([wish("c", "a-b")], made.deliver)
        signer.issue([EnrolmentRequest("scc-gateway", MemberKind.HOST, None, "scc-gateway", pool=POOL)], made.deliver)
        with pytest.raises(NameTaken, match="`scc-gateway` is the name of the pilot's own `scc-gateway`"):
            signer.issue([wish("gateway", "scc")], made.deliver)


def test_declared_host_name_is_reserved(tmp_path: Path) -> None:
    membership = stand(tmp_path).authority.membership()
    with pytest.raises(NameTaken, match="is the name of a declared host") as taken:
        check_free("scc-gateway", "scc", "gateway", membership, {"scc-gateway"})
    assert taken.value.hint == "device=gateway-2, for instance"
    assert check_free("scc-gateway", None, "scc-gateway", membership, {"scc-gateway"}) is None
