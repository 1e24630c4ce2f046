"""The folder of the authority, as every command opens it."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.journal import Holder
from atlantis_netcfg.vpn import ledger, pki
from atlantis_netcfg.vpn.authority import _check as checks
from atlantis_netcfg.vpn.authority import _files as files
from atlantis_netcfg.vpn.authority import _founding as founding
from atlantis_netcfg.vpn.authority import _head as heads
from atlantis_netcfg.vpn.authority import _lists as lists
from atlantis_netcfg.vpn.authority import _sealed as sealed
from atlantis_netcfg.vpn.authority._book import LedgerSession, new_operation
from atlantis_netcfg.vpn.authority._desk import SigningSession
from atlantis_netcfg.vpn.authority._errors import AuthorityDamaged, os_errors_as
from atlantis_netcfg.vpn.authority._lock import Lock
from atlantis_netcfg.vpn.authority._server import names_of
from atlantis_netcfg.vpn.authority._sighting import observe_sessions
from atlantis_netcfg.vpn.authority._signer import Signer
from atlantis_netcfg.vpn.ledger import records

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from datetime import datetime
    from pathlib import Path

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.vpn.authority._types import Delivered, ServerNames, SessionObservation
    from atlantis_netcfg.vpn.identity import MembershipList
    from atlantis_netcfg.vpn.ledger import Entry

__all__ = ["Authority"]


class Authority:
    """A folder with a CA, its ledger, and what follows from it. Reading takes no lock and no passphrase."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def exists(cls, folder: Path) -> bool:
        """Whether the folder has a complete authority."""
        return founding.is_complete(folder)

    @classmethod
    def init(
        cls, folder: Path, passphrase: Secret, server_names: ServerNames, who: str, sealed_by: founding.Sealing = "age"
    ) -> Authority:
        """Found an authority: CA, server certificate, tls-crypt keys, an empty list.

        Killed at any moment, the repeat begins anew; a complete one is never overwritten: it is returned if it was
        founded with the same names, else UsageError.
        """
        founding.prepare_folder(folder)
        with Lock(folder, who):
            founding.init_authority(folder, passphrase, server_names, who, sealed_by)
        return cls(folder)

    @classmethod
    def open(cls, folder: Path) -> Authority:
        """The authority of a folder. Raises NoAuthority."""
        founding.require_authority(folder)
        return cls(folder)

    def roll(self) -> MembershipList:
        """Who is in the VPN. Raises LedgerDamaged."""
        return self._fold().roll()

    def history(self) -> tuple[Entry, ...]:
        """Every entry of the ledger, oldest first. Raises LedgerDamaged."""
        return ledger.read(self.folder / ledger.FILE).sound().entries

    def server(self) -> ServerNames:
        """What the server's certificate is made out to. Raises LedgerDamaged."""
        server = self._fold().server
        if server is None:
            raise AuthorityDamaged("the ledger names no server", hint="restore the ledger from a backup")
        return names_of(server)

    def opening_bytes(self) -> int:
        """Memory that opening the CA key takes; 0: none to speak of."""
        with os_errors_as("the CA key cannot be read"):
            path = self.folder / files.SEALED["age"]
            return pki.opening_bytes(path.read_bytes()) if path.exists() else 0

    def handed_out(self, common_name: str) -> records.Delivered | None:
        """What was recorded last of a certificate's file; None: it was never handed out. Raises LedgerDamaged."""
        return self._fold().delivered.get(common_name)

    def crl(self) -> bytes:
        """The published list, PEM.

        Raises CrlRefused if no server may have it, AuthorityDamaged if it is not the one that the record names.
        """
        with os_errors_as("the revocation list cannot be read"):
            pem = (self.folder / files.CRL).read_bytes()
            ca = pki.load_cert((self.folder / files.CA).read_text(encoding="ascii"))
        facts = pki.check_crl(pem, ca, above=None, now=ledger.utc_now())
        if facts.sha256 != self.roll().crl_sha256:
            raise AuthorityDamaged(
                f"{files.CRL} (number {facts.number}) is not the list that was recorded last",
                hint="`provision vpn sync --sign` signs a new one",
            )
        return pem

    def beyond(self, pem: bytes) -> str | None:
        """What a list that a server has says beyond this record, in words; None: nothing, or it is not of this CA."""
        with os_errors_as("the certificate authority cannot be read"):
            ca = pki.load_cert((self.folder / files.CA).read_text(encoding="ascii"))
        return lists.beyond_record(self.folder, self._fold(), ca, pem)

    def check(self, now: datetime | None = None) -> list[str]:
        """Problems, in words: ledger, certificates, list, expiries; never raises for what it finds."""
        return list(checks.problems(self.folder, ledger.utc_now() if now is None else now))

    def agreement(self) -> checks.Agreement:
        """Whether the record is as it was signed, and agrees with certificates and list. Raises LedgerDamaged."""
        return checks.agreement(self.folder)

    @contextmanager
    def unlocked(
        self,
        passphrase: Callable[[], Secret],
        who: str,
        *,
        waiting: Callable[[str], None] | None = None,
        trust_clock: bool = False,
    ) -> Iterator[Signer]:
        """Sign. One process at a time: waits up to 60 s, and tells `waiting` once, in words, for whom.

        What a killed command left is finished or withdrawn first. `trust_clock`: sign although the clock stands before
        the last record, because that record's was wrong. Raises WrongPassphrase, AuthorityBusy, LedgerDamaged,
        ClockBehind, AuthorityFailed.
        """
        # Asked and opened before the lock: nobody waits for somebody who looks for the note with the passphrase.
        ca = sealed.unseal_ca(self.folder, passphrase())
        with self._signing(ca, who, waiting=waiting, trust_clock=trust_clock) as signer:
            yield signer

    @contextmanager
    def _signing(
        self, ca: pki.Ca, who: str, *, waiting: Callable[[str], None] | None = None, trust_clock: bool = False
    ) -> Iterator[Signer]:
        with self._writing(who, waiting) as (book, left):
            if book.fold.founded is None or book.fold.founded.ca_sha256 != pki.sha256(ca.certificate):
                raise AuthorityDamaged(
                    f"{files.CA} is not the certificate authority of the ledger",
                    hint="restore both from the same backup of the authority",
                )
            heads.read_head(self.folder, ca.certificate, book.fold).hold(book.digests)
            book.check_clock(trusted=trust_clock)
            prompt = SigningSession(self.folder, book, ca)
            prompt.recover(left=left)
            try:
                yield Signer(prompt)
            except BaseException:
                # Best effort: the next command that signs does it.
                with suppress(NetcfgError):
                    heads.sign_head(self.folder, book, ca)
                raise
            heads.sign_head(self.folder, book, ca)

    @contextmanager
    def _writing(self, who: str, waiting: Callable[[str], None] | None = None) -> Iterator[tuple[LedgerSession, bool]]:
        founding.require_authority(self.folder)
        with ExitStack() as exit_stack:
            lock = exit_stack.enter_context(Lock(self.folder, who or _me(), waiting))
            yield exit_stack.enter_context(LedgerSession(self.folder, who or _me())), lock.left

    def seen(self, sightings: Mapping[str, datetime], who: str = "") -> SessionObservation:
        """Record which common names the server had sessions of, and when last; an older certificate is superseded.

        Recorded is what was not seen before, and a later time when a day has passed: the server keeps the exact ones.
        """
        if not observe_sessions(self._fold(), sightings)[0]:
            return observe_sessions(self._fold(), sightings)[1]
        with self._writing(who) as (book, _):
            new, answer = observe_sessions(book.fold, sightings)
            book.write(new, new_operation())
        return answer

    def settled(self, common_names: Iterable[str], who: str = "") -> None:
        """Record that the server confirmed: these revoked certificates have no session and get none."""
        desired = set(common_names)
        if not desired.intersection(self.roll().queued):
            return
        with self._writing(who) as (book, _):
            out = [entry for entry in book.fold.roll().queued if entry in desired]
            book.write([records.Settled(common_name=item) for item in out], new_operation())

    def delivered(self, common_name: str, delivered: Delivered, who: str = "") -> None:
        """Record that a member's file was made out or handed over once more. Raises UsageError for a revoked one."""
        with self._writing(who) as (book, _):
            good = {certificate.common_name for _, certificate in book.fold.roll().certificates() if certificate.good}
            if common_name not in good:
                raise UsageError(
                    f"`{ascii(common_name)[1:-1][:70]}` is no certificate in use",
                    hint="`provision vpn list` names them all",
                )
            record = records.Delivered(common_name=common_name, path=delivered.path, sha256=delivered.sha256)
            book.write([record], new_operation())

    def reseal(self, old: Secret, new: Secret, who: str, sealed_by: founding.Sealing = "age") -> None:
        """Put the CA key under another passphrase. Once more after it was done: nothing is left to do."""
        with self._writing(who) as (book, _):
            ca = sealed.reseal_ca(self.folder, book, (old, new), sealed_by)
            heads.sign_head(self.folder, book, ca)

    def _fold(self) -> ledger.LedgerState:
        return ledger.LedgerState(self.history())


def _me() -> str:
    holder = Holder.me("")
    return f"{holder.user}@{holder.host}"
