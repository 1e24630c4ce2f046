"""Valid names: a name becomes a common name, a file name, and an identifier in nft rules."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Container

    from atlantis_netcfg.vpn.identity import Member, MembershipList

LONGEST = 48
"""Maximum characters; with a successor's `.2` below the 64 of a common name (RFC 5280, ub-common-name)."""
NAME = re.compile(r"[a-z0-9](?:[a-z0-9-]{0,46}[a-z0-9])?")
"""Name syntax, for `fullmatch`: `$` would accept a newline at the end."""

_OPENVPN = "default server"
"""OpenVPN's file for clients without their own (`DEFAULT`, in any case if the disk ignores case), and the server."""
_NFT = """
    accept add after ah all and any arp at audit auth before bridge burst bypass bytes bypassed cgroup chain chains
    classid code comment comp confirmed constant continue count counter counters cpu create ct daddr day dccp delete
    describe device devices dnat dport drop dscp dup dynamic ecn element elements eq error esp ether expectation
    expires exthdr export false fanout fib filter flags flow flowtable flowtables flush frag fwd ge geneve get goto gre
    gretap group gt handle hash hbh helper hook hour ibriport icmp icmpv6 id igmp iif iifname import in include index
    inet ingress insert interface interval ip ip6 jhash jump l4proto label last le length level limit limits list log
    lt map maps mark masquerade memory meta meter meters mh missing monitor mss name ne netdev never notrack nothdr
    numgen offset oif oifname or original osf output over packets performance persistent pkttype policy position
    postrouting prefix prerouting priority proto protocol queue quota quotas random rate redefine redirect reject
    rename replace reply reset return rt rule rules ruleset saddr sctp secmark seed set sets size snaplen snat socket
    sport src srh state status symhash synproxy table tables tcp th time timeout tproxy true ttl type typeof udp
    udplite undefine until update used version vlan vmap vxlan wscale xt xor zone
"""
RESERVED_WORDS = frozenset(f"{_OPENVPN} {_NFT}".split())
"""Words with another meaning where a name is used: nft cannot distinguish a set called `log` from the statement."""

_MAX_SHOWN = 60
_WHY = {
    "\0": msg("has a NUL in it: what comes after it is not read by everybody"),
    "/": msg("has a `/` in it, which leads to another folder"),
    "\\": msg("has a backslash in it"),
    ".": msg("has a dot in it"),
    "_": msg("has a `_` in it: write `-`"),
    " ": msg("has a space in it"),
}


class InvalidNameError(UsageError):
    """The name does not match the grammar, or is a reserved word."""


class NameTaken(UsageError):
    """The name belongs, or belonged, to somebody else: names are never reused."""


def check_name(text: str, what: str) -> str:
    """Return `text` if it is a valid name. Raises InvalidNameError, which names `what` and offers a valid name."""
    if NAME.fullmatch(text) is None:
        raise InvalidNameError(
            f"{arg(what)} `{arg(_printable(text))}` {arg(_explain_bad_name(text))}", hint=_offer(text, what)
        )
    if text in RESERVED_WORDS:
        raise InvalidNameError(
            f"{arg(what)} `{arg(text)}` is a reserved word of OpenVPN or nft",
            hint=f"{arg(what)}={arg(text)}-1, for instance",
        )
    return text


def member_name(partner: str, device: str) -> str:
    """Return `PARTNER-DEVICE`; each part and the whole are checked. Raises InvalidNameError."""
    name = f"{check_name(partner, 'partner')}-{check_name(device, 'device')}"
    if len(name) > LONGEST:
        room = LONGEST - len(partner) - 1
        short = device[: max(room, 0)].rstrip("-")
        raise InvalidNameError(
            f"`{arg(name)}` has {arg(len(name))} characters: partner and device have {arg(LONGEST)} together "
            "at most, with the `-`",
            hint=f"device={arg(short)}, for instance" if short else "take a shorter key for the partner",
        )
    return check_name(name, "name")


def check_free(
    name: str, partner: str | None, device: str, membership: MembershipList, host_names: Container[str] = ()
) -> Member | None:
    """Return the member of that name if it is this device, None if the name is free. Raises NameTaken.

    `host_names`: host names of the inventory, which no partner's device may have.
    """
    if partner is not None and name in host_names:
        raise NameTaken(
            f"`{arg(name)}` is the name of a declared host: device `{arg(device)}` of partner `{arg(partner)}` "
            "cannot have it",
            hint=f"device={arg(device)}-2, for instance",
        )
    member = membership.members.get(name)
    if member is None or (member.partner, member.device) == (partner, device):
        return member
    raise NameTaken(f"`{arg(name)}` is the name of {arg(_whose(member))}", hint=f"device={arg(device)}-2, for instance")


def _whose(member: Member) -> str:
    if member.partner is None:
        return msg(f"the pilot's own `{arg(member.device)}`")
    return msg(f"device `{arg(member.device)}` of partner `{arg(member.partner)}`")


def _printable(text: str) -> str:
    """Return printable text: look-alike and control characters are shown by their numbers."""
    message = ascii(text)[1:-1]
    return message if len(message) <= _MAX_SHOWN else f"{message[:_MAX_SHOWN]}…"


def _explain_bad_name(text: str) -> str:
    if not text:
        return msg("is empty")
    if text.endswith(("\n", "\r")):
        return msg("has a line break at its end")
    if strange := next((letter for letter in text if not letter.isascii()), None):
        return msg(f"has {arg(_letter_name(strange))} in it: letters are a to z without accents")
    for letter, why in _WHY.items():
        if letter in text:
            return why
    return _why_plain(text)


def _why_plain(text: str) -> str:
    if text.startswith("-"):
        return msg("begins with `-`, as options do")
    if text.endswith("-"):
        return msg("ends with `-`")
    if any(letter.isupper() for letter in text):
        return msg("has capital letters: names are written small")
    if wrong := next((letter for letter in text if not (letter.isalnum() or letter == "-")), None):
        return msg(f"has `{arg(_printable(wrong))}` in it: names have a to z, 0 to 9, and `-` between them")
    return msg(f"has {arg(len(text))} characters: {arg(LONGEST)} at most")


def _letter_name(letter: str) -> str:
    import unicodedata  # noqa: PLC0415 - only errors need it

    return unicodedata.name(letter, f"character U+{ord(letter):04X}")


def _offer(text: str, what: str) -> str:
    """Return a hint with the nearest valid name, if there is one."""
    import unicodedata  # noqa: PLC0415 - as above

    plain = unicodedata.normalize("NFKD", text[: 4 * LONGEST]).encode("ascii", "ignore").decode()
    near = re.sub(r"[^a-z0-9]+", "-", plain.lower())[:LONGEST].strip("-")
    if near and near not in RESERVED_WORDS:
        return msg(f"{arg(what)}={arg(near)}, for instance")
    return "a name has a to z, 0 to 9 and `-` between them, like sparus2"
