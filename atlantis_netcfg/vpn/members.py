"""Enrol, renew and revoke members, and create the authority for that.

The enrolment package is made inside the authority's transaction: the certificate is recorded before a file exists, and
the file exists before the record says that it was delivered. So a killed command can be repeated, and nothing is lost.
A revocation is first recorded and put on the list, so that it is valid whatever the server reports.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.core.paths import private_directory
from atlantis_netcfg.runs import write_atomically
from atlantis_netcfg.vpn import enrolment_package
from atlantis_netcfg.vpn.authority import model
from atlantis_netcfg.vpn.authority.authority import Authority
from atlantis_netcfg.vpn.enrolment_package.profile import identity_file, server_name
from atlantis_netcfg.vpn.names import check_free
from atlantis_netcfg.vpn.requests import computers

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from contextlib import AbstractContextManager
    from ipaddress import IPv4Address

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.vpn.authority.signer import Signer
    from atlantis_netcfg.vpn.identity import Identity, Member


@dataclass(frozen=True, slots=True)
class OperatorContext:
    """The operator's access to the authority."""

    authority: Authority
    who: str
    """User name for the ledger."""
    waiting: Callable[[str], None]
    """Called with the lock holder's description while the command waits."""
    trust_clock: bool = False
    """The user confirms this computer's clock, although the ledger's last entry is later."""

    def unlock(self, passphrase: Callable[[], Secret]) -> AbstractContextManager[Signer]:
        """Open a signing session, see `Authority.unlock`."""
        return self.authority.unlock(passphrase, self.who, waiting=self.waiting, trust_clock=self.trust_clock)


CONTACT = "whoever gave you this file"
_CONTACT_MAX = 200


@dataclass(frozen=True, slots=True)
class PackageTarget:
    """Recipients of enrolment packages, and the folder for copies."""

    recipients: Mapping[str, str] = field(default_factory=dict)
    """Public keys by member name; other members get a one-time passphrase."""
    copies: Path | None = None
    contact: str = CONTACT
    """Contact for the owner of a device, printed on the instruction page."""

    def __post_init__(self) -> None:
        """Raise UsageError for values that would fail during issuing."""
        if self.copies is not None and not self.copies.is_dir():
            raise UsageError(f"folder {arg(self.copies)} does not exist", hint="create it first, or leave `to=` out")
        if not self.contact.strip() or not self.contact.isprintable() or len(self.contact) > _CONTACT_MAX:
            raise UsageError(
                f"`contact=` must be one line of at most {arg(_CONTACT_MAX)} characters",
                hint="for example a name, a telephone number and an e-mail address",
            )


@dataclass(frozen=True, slots=True)
class DeliveredMember:
    """A member, its newest certificate, and the file for the owner of the device."""

    result: model.IssueResult
    file: Path
    copy: Path | None = None
    cover_note: Path | None = None
    """Text sent together with the file; None: nothing is sent, or it was created before."""
    passphrase: Secret | None = None
    """Passphrase of the file, shown only this once."""


def reserved_addresses(inventory: Inventory, requests: Sequence[model.EnrolmentRequest] = ()) -> frozenset[IPv4Address]:
    """Return addresses reserved by the inventory: of the server, computers and DDS peers.

    An address named by a request is available for that member.
    """
    pilot = inventory.pilot
    server = getattr(inventory.hosts[pilot.vpn.server].device, "vpn_address", None)
    peers = pilot.dds.peers if pilot.dds is not None else ()
    used_addresses = {*computers(inventory).values(), *(peer.address for peer in peers)}
    return frozenset(
        {*used_addresses, *([] if server is None else [server])} - {request.address for request in requests}
    )


@dataclass(slots=True)
class Onboarding:
    """The issuing of one command: delivered files are kept by common name until the command prints them."""

    inventory: Inventory
    operator: OperatorContext
    target: PackageTarget
    _packages: dict[str, tuple[Path, Path | None, Path, Secret | None]] = field(default_factory=dict)

    def find_existing(self, requests: Sequence[model.EnrolmentRequest]) -> tuple[DeliveredMember, ...]:
        """Return the members if all exist exactly as requested, so that no passphrase is needed.

        Empty if anything remains to be done. Raises NameTaken.
        """
        membership = self.operator.authority.membership()
        members = [check_free(request.name, request.partner, request.device, membership) for request in requests]
        pairs = [(enrolment, member) for enrolment, member in zip(requests, members, strict=True) if member is not None]
        same = all(_same(request, member) for request, member in pairs)
        return (
            tuple(self._existing_delivery(member) for _, member in pairs)
            if same and len(pairs) == len(requests)
            else ()
        )

    def _existing_delivery(self, member: Member) -> DeliveredMember:
        newest = member.good[-1]
        path = _package_path(self.operator.authority.folder, newest.common_name)
        if member.partner is None and not path.exists():
            path = enrolment_package.host_identity(self.operator.authority.folder, member.name)
        digest = sha256(path.read_bytes()).hexdigest() if path.exists() else ""
        return DeliveredMember(
            model.IssueResult(member, newest, model.EnrolmentFile(str(path), digest), already=True), path
        )

    def issue(
        self, requests: Sequence[model.EnrolmentRequest], passphrase: Callable[[], Secret]
    ) -> tuple[DeliveredMember, ...]:
        """Create the members. Raises UsageError for refused requests, and the errors of `Authority.unlock`."""
        addresses = reserved_addresses(self.inventory, requests)
        with self.operator.unlock(passphrase) as signer:
            return tuple(
                self._new_delivery(item) for item in signer.issue(requests, self._deliver, reserved_addresses=addresses)
            )

    def renew(
        self, renewals: Sequence[tuple[Member, model.RenewalRequest]], passphrase: Callable[[], Secret]
    ) -> tuple[DeliveredMember, ...]:
        """Issue a successor for each certificate, with the changes of its request."""
        with self.operator.unlock(passphrase) as signer:
            return tuple(
                self._new_delivery(signer.renew(member.name, self._deliver, change)) for member, change in renewals
            )

    def _new_delivery(self, result: model.IssueResult) -> DeliveredMember:
        name = result.certificate.common_name
        return DeliveredMember(result, *self._packages.get(name, (Path(result.file.path), None, None, None)))

    def _deliver(self, identity: Identity) -> model.EnrolmentFile:
        """Write the member's file, before its delivery is recorded."""
        recipient = self.target.recipients.get(identity.member.name)
        if identity.member.partner is None:
            package_file = self._keep(identity)
            if recipient is None and self.target.copies is None:
                return package_file
        sealing = enrolment_package.OneTimePassphrase() if recipient is None else enrolment_package.Recipient(recipient)
        package = enrolment_package.build_package(self.inventory, identity, sealing, contact=self.target.contact)
        common_name = identity.certificate.common_name
        place = _package_path(self.operator.authority.folder, common_name)
        private_directory(place.parent)
        write_atomically(place, package.data)
        note, text = place.with_name(f"{common_name}.cover-note.txt"), package.cover_note.encode()
        write_atomically(note, text)
        copy = self._write_copy(package.file_name, package.data)
        note = self._write_copy(note.name, text) or note
        self._packages[common_name] = (place, copy, note, package.passphrase)
        return model.EnrolmentFile(str(place), package.sha256)

    def _keep(self, identity: Identity) -> model.EnrolmentFile:
        """Store the identity of an inventory computer, for the role that installs it."""
        data = identity_file(identity).reveal().encode()
        place = enrolment_package.host_identity(self.operator.authority.folder, identity.member.name)
        private_directory(place.parent)
        write_atomically(place, data)
        return model.EnrolmentFile(str(place), sha256(data).hexdigest())

    def _write_copy(self, name: str, data: bytes) -> Path | None:
        if self.target.copies is None:
            return None
        place = self.target.copies / name
        write_atomically(place, data)
        return place


def _package_path(folder: Path, common_name: str) -> Path:
    return folder / "handouts" / common_name / f"{common_name}.tar.age"


def _same(request: model.EnrolmentRequest, member: Member) -> bool:
    """Return True if the member already matches the request."""
    newest = member.good[-1] if member.good else None
    return (
        newest is not None
        and request.system in {None, member.system}
        and request.distribution in {None, member.distribution}
        and (member.kind, member.link, member.vehicle) == (request.kind, request.link, request.vehicle)
        and (newest.wrap, newest.key) == (request.wrap, request.key)
        and request.address in {None, member.address}
    )


_LONGEST = 100


def reason_of(text: str | None) -> str:
    """Return the reason for the record. Raises UsageError unless it is one short line."""
    if text is None:
        return "no reason given"
    if not text.isprintable() or len(text) > _LONGEST:
        raise UsageError(
            f"a reason must be one line of at most {arg(_LONGEST)} characters", hint="for example `reason=stolen`"
        )
    return text


def revoke(
    operator: OperatorContext, members: Sequence[Member], reason: str, passphrase: Callable[[], Secret]
) -> model.RevocationResult:
    """Record the revocation and publish the list; the server is not contacted here."""
    with operator.unlock(passphrase) as signer:
        return signer.revoke([member.name for member in members], reason)


def server_names(inventory: Inventory) -> model.ServerNames:
    """Return the names in the server's certificate; RouterOS compares them with the address it connects to."""
    vpn = inventory.pilot.vpn
    lan = getattr(inventory.hosts[vpn.server].device, "address", None)
    addresses = (vpn.endpoint,) if lan is None else (vpn.endpoint, lan)
    return model.ServerNames(server_name(inventory), (vpn.endpoint_name,), addresses)


def existing_authority(folder: Path, inventory: Inventory) -> Authority | None:
    """Return the existing authority. Raises UsageError if its server differs from the inventory's."""
    if not Authority.exists(folder):
        return None
    authority = Authority.open(folder)
    names, declared_names = authority.server(), server_names(inventory)
    if names != declared_names:
        raise UsageError(
            f"the authority in {arg(folder)} is for the server {arg(_names_text(names))}, but the inventory has "
            f"{arg(_names_text(declared_names))}",
            hint=(
                "if the inventory is right, run `provision vpn sync --sign` to issue a new server certificate; for "
                "another authority, use another folder: `authority=FOLDER`"
            ),
        )
    return authority


def refuse_example_authority(inventory: Inventory, *, is_explicit: bool) -> None:
    """Raise UsageError if the inventory has example values, unless an explicit folder makes this a trial."""
    if inventory.pilot.example_values and not is_explicit:
        raise UsageError(
            "the inventory still contains example values: identities made from it would not work",
            hint=(
                "replace them and set `example_values: false` in group_vars/all/pilot.yml; to try things out, use "
                "a separate folder: `authority=FOLDER`"
            ),
        )


def _names_text(names: model.ServerNames) -> str:
    return join(", ", [names.common_name, *names.dns, *map(str, names.addresses)])
