"""One sealed file for one member, and the way back."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.vpn import routeros
from atlantis_netcfg.vpn.enrolment_package import _page as pages
from atlantis_netcfg.vpn.enrolment_package._archive import pack, unpack
from atlantis_netcfg.vpn.enrolment_package._identity import identity_file
from atlantis_netcfg.vpn.enrolment_package._profile import is_declared, profile
from atlantis_netcfg.vpn.enrolment_package._sealed import seal, unseal
from atlantis_netcfg.vpn.enrolment_package._self_test import facts, program
from atlantis_netcfg.vpn.identity import Kind

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.vpn.enrolment_package._sealed import Sealing
    from atlantis_netcfg.vpn.identity import Identity

__all__ = ["HandOut", "contents", "handout", "open_handout"]

_CONTACT_MAX = 200
_WHAT = {
    ".ovpn": "the profile, with the private key; for nobody else",
    ".identity": "certificates and keys; for nobody else",
    ".rsc": "what the router runs to take the profile",
    "README.txt": "this page",
    "README.html": "the same for a browser",
    "restart.conf": "starts the tunnel again whatever ended it",
    "self-test.py": "tells whether the device is in the VPN, and if not, why",
    "self-test.json": "what the test compares with; no secret is in it",
}


@dataclass(frozen=True, slots=True)
class HandOut:
    """What leaves the control centre."""

    file_name: str
    data: bytes = field(repr=False)
    passphrase: Secret | None
    """To be shown once and told by telephone; None where the file is for somebody's key."""

    @property
    def sha256(self) -> str:
        """Of the file, hex."""
        return hashlib.sha256(self.data).hexdigest()


def handout(declaration: Declaration, identity: Identity, sealing: Sealing, *, contact: str) -> HandOut:
    """Seal a member's hand-out. `contact` is whom its owner calls; nothing is written to a disk.

    Raises RecipientRefused for a key that is none, UsageError for a contact that does not fit on a line.
    """
    name = identity.certificate.common_name
    files = contents(declaration, identity, contact=contact)
    packed = pack(name, files, int(identity.certificate.not_before.timestamp()))
    data, passphrase = seal(packed, sealing)
    return HandOut(_file_name(identity), data, passphrase)


def open_handout(data: bytes, secret: Secret) -> dict[str, str]:
    """The files of a hand-out, by name; `told` is its passphrase, or the `AGE-SECRET-KEY-1…` that it is sealed for.

    Raises WrongKey, NotAHandOut.
    """
    return unpack(unseal(data, secret))


def contents(declaration: Declaration, identity: Identity, *, contact: str) -> dict[str, str]:
    """The files of a hand-out before they are sealed, the one with the key first. They hold secrets."""
    if not contact.strip() or not contact.isprintable() or len(contact) > _CONTACT_MAX:
        raise UsageError(
            f"whom a partner calls has to be one line of at most {_CONTACT_MAX} characters",
            hint="for example a name, a telephone number and a mail address",
        )
    local = _key_files(declaration, identity)
    lines = (*local, "README.txt", "README.html", *_beside(identity.member.kind))
    view = pages.page_view(
        declaration,
        identity,
        contact=contact.strip(),
        sealed_file=_file_name(identity),
        files=[(name, _what(name)) for name in lines],
    )
    page = pages.page(view)
    made = {**local, "README.txt": pages.as_text(page), "README.html": pages.as_html(page)}
    if "restart.conf" in lines:
        made["restart.conf"] = pages.restart(view)
    if "self-test.py" in lines:
        ovpn = f"{identity.member.name}.ovpn"
        made["self-test.py"] = program()
        made["self-test.json"] = facts(declaration, identity, profile(declaration, identity), ovpn, view.contact)
    return made


def _file_name(identity: Identity) -> str:
    return f"{identity.certificate.common_name}.tar.age"


def _key_files(declaration: Declaration, identity: Identity) -> Mapping[str, str]:
    """The file with the key, and what a router runs to take it."""
    name = identity.member.name
    if is_declared(identity.member):
        return {f"{name}.identity": identity_file(identity).reveal()}
    if identity.member.kind is Kind.ROUTER:
        ovpn = f"{name}.ovpn"
        text = routeros.profile(declaration, identity).reveal()
        return {ovpn: text, f"{name}.rsc": routeros.script(declaration, identity, ovpn)}
    return {f"{name}.ovpn": profile(declaration, identity).reveal()}


def _what(name: str) -> str:
    return _WHAT.get(name) or _WHAT[name[name.rindex(".") :]]


def _beside(kind: Kind) -> tuple[str, ...]:
    """What else is in the hand-out of such a member; on a router and a declared computer nothing of ours is tried."""
    tests = ("self-test.py", "self-test.json")
    return {Kind.ROBOT: ("restart.conf", *tests), Kind.LAPTOP: tests}.get(kind, ())
