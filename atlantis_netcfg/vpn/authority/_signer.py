"""What is done with the CA key, while its lock is held."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority import _plan as plan
from atlantis_netcfg.vpn.authority import _types as types
from atlantis_netcfg.vpn.authority._book import new_operation
from atlantis_netcfg.vpn.authority._errors import os_errors_as
from atlantis_netcfg.vpn.authority._files import CRL
from atlantis_netcfg.vpn.authority._issuing import hand_out
from atlantis_netcfg.vpn.authority._server import needs_another
from atlantis_netcfg.vpn.identity import Certificate, CertificateStatus, Member
from atlantis_netcfg.vpn.ledger import records

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Sequence
    from ipaddress import IPv4Address

    from atlantis_netcfg.vpn.authority._desk import SigningSession
    from atlantis_netcfg.vpn.identity import Identity, MembershipList

__all__ = ["Signer"]

SUPERSEDED = "superseded"
TAKEN = "revoked by the server's list, which a copy of the authority has signed that is lost"


class Signer:
    """Got by `Authority.unlocked()`; good inside that block only."""

    def __init__(self, prompt: SigningSession) -> None:
        self._desk = prompt

    @property
    def roll(self) -> MembershipList:
        """The roll as it stands after what this signer has done."""
        return self._desk.book.fold.roll()

    def issue(
        self,
        wishes: Sequence[types.EnrolmentRequest],
        deliver: Callable[[Identity], types.Delivered],
        *,
        reserved: Collection[IPv4Address] = (),
    ) -> tuple[types.Issued, ...]:
        """Make members, all checked before the first is made; answers are in the order of the wishes.

        `deliver` is called when the certificate is recorded, and writes the file atomically, 0600. `reserved` are
        addresses that are not given away: the server's own, and those of declared hosts. UsageError for a name that is
        refused or taken, for a member of this name that is not the one wished for, for an address in use.
        """
        planned = plan.plan_issue(self.roll, wishes, reserved)
        new = [entry for entry in planned if isinstance(entry, plan.Planned)]
        if new:
            hand_out(self._desk, "issue", new, deliver)
        names = {item.member.name for item in new}
        return tuple(self._issued(request.name, already=request.name not in names) for request in wishes)

    def renew(
        self, name: str, deliver: Callable[[Identity], types.Delivered], change: types.RenewalRequest | None = None
    ) -> types.Issued:
        """Give a member a successor `NAME.2`, `NAME.3` …; the certificate in use works until the new one was seen.

        Successors that were handed out before and never seen are revoked (`Issued.replaced`).
        """
        planned = plan.plan_renewal(plan.known_member(self.roll, name), change or types.RenewalRequest())
        hand_out(self._desk, "renew", [planned], deliver)
        return self._issued(name, replaced=planned.replaces)

    def revoke(self, names: Sequence[str], reason: str) -> types.Revoked:
        """Revoke every certificate of these members, and publish the list. The names never return.

        Once more for members that are revoked: nothing new is recorded, the answer is the same.
        """
        roll = self.roll
        members = [plan.known_member(roll, name) for name in dict.fromkeys(names)]
        if not members:
            raise UsageError(
                "nobody was named whose certificates are to be revoked", hint="`provision vpn list` names them all"
            )
        why = plan.printable_text(reason, "the reason") or "no reason was given"
        lost = [_revocable(member) for member in members]
        if any(lost):
            crl = self._revoke(
                [member.name for member in members], [certificate for some in lost for certificate in some], why
            )
        else:
            with os_errors_as("the revocation list cannot be read"):
                crl = (self._desk.folder / CRL).read_bytes()
        handed_out = self._desk.book.fold.delivered
        every = (entry.common_name for member in members for entry in member.certificates)
        return types.Revoked(
            common_names=tuple(item for item in every if item in handed_out),
            members=tuple(member.name for member in members),
            crl=crl,
            already=tuple(member.name for member, some in zip(members, lost, strict=True) if not some),
        )

    def publish(self) -> bytes:
        """Sign the list anew, superseded certificates on it as well; PEM."""
        old = [
            certificate
            for _, certificate in self.roll.certificates()
            if certificate.standing is CertificateStatus.SUPERSEDED
        ]
        operation = new_operation()
        begun = records.Begun(command="publish")
        self._desk.book.write([begun, *_revocations(old, SUPERSEDED)], operation)
        return self._listed(operation)

    def take(self, pem: bytes) -> tuple[str, ...]:
        """Take over the list that a server has, of a copy of this authority that is lost, and sign the next one.

        Gives the common names that are revoked by that; what the record has never issued stays on the list.
        Raises CrlRefused for a list of another CA.
        """
        facts = pki.read_crl(pem, self._desk.ca.certificate)
        ours = [entry for _, entry in self.roll.certificates() if entry.serial in facts.serials]
        lost = [item for item in ours if item.standing is not CertificateStatus.REVOKED]
        strange = facts.serials - {our.serial for our in ours} - self._desk.book.fold.taken.keys()
        taken = [records.Taken(serials=tuple(sorted(strange)))] if strange else []
        operation = new_operation()
        begun = records.Begun(command="publish")
        self._desk.book.write([begun, *taken, *_revocations(lost, TAKEN)], operation)
        self._listed(operation, facts)
        return tuple(certificate.common_name for certificate in lost)

    def serve(self, names: types.ServerNames) -> bool:
        """Give the server a new certificate, if the one it has is for other names, or ends within 90 days.

        True if there is a new one: the server's computer needs it. Members go on with what they have.
        """
        if not needs_another(self._desk.book.fold.server, names, self._desk.book.now()):
            return False
        self._desk.serve(names)
        return True

    def _revoke(self, names: Sequence[str], certificates: Iterable[Certificate], why: str) -> bytes:
        operation = new_operation()
        begun = records.Begun(command="revoke", names=tuple(names))
        self._desk.book.write([begun, *_revocations(certificates, why)], operation)
        return self._listed(operation)

    def _listed(self, operation: str, also: pki.CrlFacts | None = None) -> bytes:
        pem = self._desk.publish(operation, also)
        self._desk.book.write([records.Committed()], operation)
        return pem

    def _issued(self, name: str, *, already: bool = False, replaced: tuple[str, ...] = ()) -> types.Issued:
        fold = self._desk.book.fold
        member = fold.member(name)
        newest = member.good[-1]
        last = fold.delivered[newest.common_name]
        return types.Issued(member, newest, types.Delivered(last.path, last.sha256), already, replaced)


def _revocable(member: Member) -> list[Certificate]:
    """What a revocation of the member is about; once for one that was never handed out, so that its name is retired."""
    good = [item for item in member.certificates if item.standing is not CertificateStatus.REVOKED]
    waits = not good and all(certificate.reason == plan.NEVER_HANDED_OUT for certificate in member.certificates)
    return list(member.certificates) if waits else good


def _revocations(certificates: Iterable[Certificate], why: str) -> list[records.Record]:
    return [records.Revoked(common_name=certificate.common_name, reason=why) for certificate in certificates]
