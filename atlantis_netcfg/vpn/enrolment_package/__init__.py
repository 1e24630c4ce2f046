"""The enrolment package of a member: profile, instructions and self-test, sealed for this member alone.

The content is a pure function of inventory, identity and contact, so page, profile and test agree. It exists in memory
only until it is sealed: no step writes a secret to a disk. This Python package also reads it back (`accept`), so that a
host of the inventory is enrolled the same way as every partner.
"""

from __future__ import annotations

import hashlib
import io
import re
import secrets
import tarfile
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory.model import Router
from atlantis_netcfg.runs import write_atomically
from atlantis_netcfg.vpn import pki, routeros
from atlantis_netcfg.vpn.enrolment_package import page as pages
from atlantis_netcfg.vpn.enrolment_package.profile import (
    NotAnIdentity,
    identity_file,
    is_declared,
    profile,
    read_identity,
)
from atlantis_netcfg.vpn.enrolment_package.self_test import facts, program
from atlantis_netcfg.vpn.identity import ClientSystem, Identity, Member, MemberKind
from atlantis_netcfg.vpn.systems import system_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime
    from ipaddress import IPv4Address
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory


_NAME = re.compile(r"[a-z0-9][a-z0-9.-]{0,79}/[A-Za-z0-9][A-Za-z0-9.-]{0,79}")
_FILES, _BYTES = 20, 1024 * 1024
_PRIVATE = 0o600


class InvalidPackage(UsageError):
    """A file is not an enrolment package of ours, or is damaged."""

    def __init__(self, what: str) -> None:
        super().__init__(
            msg(f"this is not an enrolment package of the VPN: {arg(what)}"),
            hint="ask the control centre for a new one",
        )


def pack(folder: str, files: Mapping[str, str], mtime: int) -> bytes:
    """Return a tar with one folder; `mtime` is in seconds since 1970, for every file.

    Deterministic. It is a tar and not a zip, since a tar is unpacked directly from the output of `age --decrypt`: no
    key touches the disk on its way, and every unpacker keeps the file modes.
    """
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as archive:
        for name, text in files.items():
            data = text.encode()
            entry = tarfile.TarInfo(f"{folder}/{name}")
            if _NAME.fullmatch(entry.name) is None:
                raise ValueError(msg(f"not a name for an enrolment package: {arg(entry.name)!r}"))
            entry.size, entry.mtime, entry.mode = len(data), mtime, _PRIVATE
            archive.addfile(entry, io.BytesIO(data))
    return buffer.getvalue()


def unpack(data: bytes) -> dict[str, str]:
    """Return names and texts in archive order, without the folder. Raises NotAHandOut; writes nothing."""
    if len(data) > _BYTES:
        raise InvalidPackage(msg(f"it is larger than {arg(_BYTES)} bytes"))
    try:
        with tarfile.open(fileobj=io.BytesIO(data), mode="r:") as archive:
            return _texts(archive)
    except (tarfile.TarError, UnicodeDecodeError, ValueError, OSError):
        raise InvalidPackage("its content cannot be read") from None


def _texts(archive: tarfile.TarFile) -> dict[str, str]:
    result: dict[str, str] = {}
    folders: set[str] = set()
    for entry in archive:
        folder, _, name = entry.name.partition("/")
        content = archive.extractfile(entry) if entry.type == tarfile.REGTYPE and _NAME.fullmatch(entry.name) else None
        if content is None or name in result or len(result) == _FILES:
            raise InvalidPackage(msg(f"it contains {arg(ascii(entry.name))}"))
        folders.add(folder)
        result[name] = content.read().decode()
    if len(folders) != 1:
        raise InvalidPackage("it is empty" if not folders else "it contains more than one folder")
    return result


_GROUPS, _DIGITS = 5, 5
_SECRET_KEY = "AGE-SECRET-KEY-"  # noqa: S105 - how such a key begins


@dataclass(frozen=True, slots=True)
class Recipient:
    """A recipient with the private key of this public key."""

    public: str
    """Recipient's public key: `age1…`, or the line of an `ssh-ed25519` or `ssh-rsa` key."""


@dataclass(frozen=True, slots=True)
class OneTimePassphrase:
    """A recipient who is given a passphrase generated for this one file."""


Sealing = Recipient | OneTimePassphrase


def seal(data: bytes, sealing: Sealing) -> tuple[bytes, Secret | None]:
    """Return the sealed bytes, and the passphrase if there is one. Raises InvalidRecipientError.

    Sealed for the recipient's key, or with a passphrase that is given by telephone and stored nowhere.
    """
    if isinstance(sealing, Recipient):
        return pki.seal_for(data, sealing.public), None
    passphrase = _passphrase()
    return pki.seal(data, passphrase), passphrase


def unseal(data: bytes, secret: Secret) -> bytes:
    """Decrypt; `secret` is the passphrase or an `AGE-SECRET-KEY-1…`. Raises WrongPassphrase, NotAHandOut."""
    by_key = secret.reveal().strip().startswith(_SECRET_KEY)
    try:
        return pki.unseal_with(data, secret) if by_key else pki.unseal(data, _as_made(secret))
    except pki.CorruptSealError:
        raise InvalidPackage("it is not sealed, or was damaged on the way") from None
    except pki.WrongPassphrase:
        raise WrongKey(by_key=by_key) from None


class WrongKey(UsageError):
    """The file seems complete, but the typed secret does not open it."""

    def __init__(self, *, by_key: bool) -> None:
        super().__init__(
            "this key does not open the enrolment package"
            if by_key
            else "this passphrase does not open the enrolment package",
            hint=msg(
                "use the key that the control centre was given"
                if by_key
                else f"it has {arg(_GROUPS)} groups of {arg(_DIGITS)} digits: ask the control centre to read it out "
                "again"
            ),
        )


def _passphrase() -> Secret:
    """Return a passphrase of 25 digits, 83 bits: digits are easy to dictate by telephone in every language."""
    groups = (f"{secrets.randbelow(10**_DIGITS):0{_DIGITS}}" for _ in range(_GROUPS))
    return Secret("-".join(groups))


def _as_made(passphrase: Secret) -> Secret:
    """Normalise a passphrase: digits may be typed with spaces, without separators, or as shown."""
    digits = re.sub(r"[\s-]", "", passphrase.reveal())
    if not re.fullmatch(rf"[0-9]{{{_GROUPS * _DIGITS}}}", digits):
        return passphrase
    return Secret("-".join(digits[at : at + _DIGITS] for at in range(0, len(digits), _DIGITS)))


_CONTACT_MAX = 200
_WHAT = {
    ".ovpn": "the profile, with the private key: keep it secret",
    ".identity": "certificates and keys: keep them secret",
    ".rsc": "what the router runs to import the profile",
    "README.txt": "this page",
    "README.html": "the same for a browser",
    "install.sh": "performs the steps of this page on the robot, and can be repeated",
    "restart.conf": "restarts the tunnel whenever it ends",
    "self-test.py": "shows whether the device is in the VPN, and if not, why",
    "self-test.ps1": "the same for Windows PowerShell",
    "self-test.json": "the reference data of the test; it contains no secret",
    "cyclonedds.xml": "the profile of Cyclone DDS",
    "fastdds.xml": "the profile of Fast DDS",
    "ros.env": "the environment of ROS 2 programs, for systemd services",
    "setup.bash": "the same for shells",
    "setup.ps1": "the same for PowerShell",
}


@dataclass(frozen=True, slots=True)
class EnrolmentPackage:
    """An enrolment package and its cover note."""

    file_name: str
    cover_note: str
    """Text sent together with the file; it contains no secret."""
    data: bytes = field(repr=False)
    passphrase: Secret | None
    """Shown once, to be passed on by telephone; None: the file is encrypted for the owner's key."""

    @property
    def sha256(self) -> str:
        """SHA-256 of the file, hex."""
        return hashlib.sha256(self.data).hexdigest()


def build_package(inventory: Inventory, identity: Identity, sealing: Sealing, *, contact: str) -> EnrolmentPackage:
    """Create a member's sealed enrolment package. `contact` is the person to call; nothing is written to a disk.

    Raises InvalidRecipientError for an invalid key, UsageError for a contact that does not fit on a line.
    """
    name = identity.certificate.common_name
    files = contents(inventory, identity, contact=contact)
    archive = pack(name, files, int(identity.certificate.not_before.timestamp()))
    data, passphrase = seal(archive, sealing)
    view = _view(inventory, identity, contact, tuple(files))
    note = pages.CoverNote(hashlib.sha256(data).hexdigest(), passphrase=passphrase is not None)
    return EnrolmentPackage(_file_name(identity), pages.cover_note(view, note), data, passphrase)


def open_package(data: bytes, secret: Secret) -> dict[str, str]:
    """Return the files of an enrolment package; `secret` is its passphrase, or the `AGE-SECRET-KEY-1…` for it.

    Raises WrongKey, NotAHandOut.
    """
    return unpack(unseal(data, secret))


def contents(inventory: Inventory, identity: Identity, *, contact: str) -> dict[str, str]:
    """Return the files of an enrolment package before sealing, the one with the key first. They contain secrets."""
    if not contact.strip() or not contact.isprintable() or len(contact) > _CONTACT_MAX:
        raise UsageError(
            f"the contact for a partner must be one line of at most {arg(_CONTACT_MAX)} characters",
            hint="for example a name, a telephone number and an e-mail address",
        )
    local = _key_files(inventory, identity)
    names = (*local, "README.txt", "README.html", *_extra_files(inventory, identity.member))
    view = _view(inventory, identity, contact, names)
    page = pages.page(view)
    file_texts = {**local, "README.txt": pages.as_text(page), "README.html": pages.as_html(page)}
    file_texts.update({name: pages.beside(view, name) for name in names if name in pages.BESIDE})
    file_texts.update({name: program(name) for name in view.tests})
    if view.tests:
        ovpn = f"{identity.member.name}.ovpn"
        file_texts["self-test.json"] = facts(inventory, identity, profile(inventory, identity), ovpn, view.contact)
    if view.dds is not None:
        file_texts.update(pages.dds_files(view.dds))
    return {name: file_texts[name] for name in names}


def _view(inventory: Inventory, identity: Identity, contact: str, names: tuple[str, ...]) -> pages.PageView:
    files = [(name, _describe_file(name)) for name in names]
    file_name = _file_name(identity)
    return pages.page_view(inventory, identity, contact=contact.strip(), sealed_file=file_name, files=files)


def _file_name(identity: Identity) -> str:
    return f"{identity.certificate.common_name}.tar.age"


def _key_files(inventory: Inventory, identity: Identity) -> Mapping[str, str]:
    """Return the file with the key, and a router's script that installs it."""
    name = identity.member.name
    if is_declared(identity.member):
        return {f"{name}.identity": identity_file(identity).reveal()}
    if identity.member.kind is MemberKind.ROUTER:
        ovpn = f"{name}.ovpn"
        text = routeros.profile(inventory, identity).reveal()
        return {ovpn: text, f"{name}.rsc": routeros.script(inventory, identity, ovpn)}
    return {f"{name}.ovpn": profile(inventory, identity).reveal()}


def _describe_file(name: str) -> str:
    return _WHAT.get(name) or _WHAT[name[name.rindex(".") :]]


def _extra_files(inventory: Inventory, member: Member) -> tuple[str, ...]:
    """Return further files for such a member; none for a router or a computer of the inventory."""
    if member.kind not in {MemberKind.ROBOT, MemberKind.LAPTOP}:
        return ()
    install = ("install.sh", "restart.conf") if member.kind is MemberKind.ROBOT else ()
    dds = _DDS[system_of(member)] if pages.dds_view(inventory, member) is not None else ()
    return (*install, *_TESTS[system_of(member)], *dds)


_PYTHON, _POWERSHELL = ("self-test.py", "self-test.json"), ("self-test.ps1", "self-test.json")
_XML, _SHELL = ("cyclonedds.xml", "fastdds.xml"), ("ros.env", "setup.bash")
_TESTS: Mapping[ClientSystem | None, tuple[str, ...]] = {
    ClientSystem.LINUX: _PYTHON,
    ClientSystem.UBUNTU_DESKTOP: _PYTHON,
    ClientSystem.WINDOWS: _POWERSHELL,
    ClientSystem.MACOS: _PYTHON,
    ClientSystem.ANDROID: (),
    ClientSystem.IOS: (),
    None: ("self-test.py", *_POWERSHELL),
}
"""Self-test files of each system; None: system unknown."""
_DDS: Mapping[ClientSystem | None, tuple[str, ...]] = {
    ClientSystem.LINUX: (*_XML, *_SHELL),
    ClientSystem.UBUNTU_DESKTOP: (*_XML, *_SHELL),
    ClientSystem.WINDOWS: (*_XML, "setup.ps1"),
    ClientSystem.MACOS: (*_XML, "setup.bash"),
    ClientSystem.ANDROID: (),
    ClientSystem.IOS: (),
    None: (*_XML, *_SHELL, "setup.ps1"),
}
"""DDS files of each system; None: system unknown."""


_ENDING = ".identity"


@dataclass(frozen=True, slots=True)
class AcceptResult:
    """The accepted identity and where it is stored."""

    identity: Identity
    path: Path
    already: bool
    """Whether the same identity was already stored."""


def host_identity(authority: Path, host: str) -> Path:
    """Return where the identity of a host of the inventory is stored, mode 0600."""
    return authority / "hosts" / f"{host}{_ENDING}"


def accept(inventory: Inventory, data: bytes, secret: Secret, authority: Path, *, now: datetime) -> AcceptResult:
    """Open a host's enrolment package, check it against this inventory, and store its identity.

    Raises WrongKey, NotAHandOut, NotAnIdentity; UsageError if the host is not a VPN member in the inventory, and for an
    identity that has expired or is older than the stored one.
    """
    identity = _identity(open_package(data, secret))
    _check_identity(inventory, identity, now)
    path = host_identity(authority, identity.member.name)
    already = _is_stored(path, identity)
    if not already:
        for folder in (authority, path.parent):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_atomically(path, identity_file(identity).reveal().encode())
    return AcceptResult(identity, path, already)


def _identity(files: dict[str, str]) -> Identity:
    profile_texts = [text for name, text in files.items() if name.endswith(_ENDING)]
    if len(profile_texts) != 1:
        raise InvalidPackage("it is for a partner's device, not for a computer of the inventory")
    return read_identity(profile_texts[0])


def _check_identity(inventory: Inventory, identity: Identity, now: datetime) -> None:
    member, certificate = identity.member, identity.certificate
    host = inventory.hosts.get(member.name)
    if host is None or member.partner is not None:
        raise UsageError(
            f"the enrolment package is for {arg(member.name)}, which is not a host of this inventory",
            hint="use the inventory of the pilot that it was made for",
        )
    if (expected_address := _tunnel_address(host)) != member.address:
        raise UsageError(
            f"the enrolment package gives {arg(member.name)} the address {arg(member.address)}, but the inventory has "
            f"{arg(expected_address)}",
            hint="use the newest inventory, or ask for a new enrolment package",
        )
    if now > certificate.not_after:
        raise UsageError(
            f"the certificate of {arg(member.name)} expired on {arg(certificate.not_after):%Y-%m-%d}",
            hint="check the clock of this computer, or ask the control centre to renew the certificate",
        )


def _tunnel_address(host: Host) -> IPv4Address | None:
    """Return the VPN address of a host in the inventory; None if it has none."""
    if isinstance(host.device, Router):
        return host.device.vpn_client.address if host.device.vpn_client is not None else None
    return getattr(host.device, "vpn_address", None)


def _is_stored(path: Path, identity: Identity) -> bool:
    """Return True if the same identity is stored. Raises UsageError if the stored one is newer."""
    try:
        there = read_identity(path.read_text(encoding="utf-8")).certificate
    except (FileNotFoundError, UnicodeDecodeError, NotAnIdentity):
        return False
    if there.not_before > identity.certificate.not_before:
        raise UsageError(
            f"a newer identity of {arg(identity.member.name)} already exists: {arg(path)}",
            hint="use the newest enrolment package; to go back to this one, move that file away first",
        )
    return there == identity.certificate
