"""The authority's folder as used by commands: read it, sign with it, or create it.

Creation writes everything beside the ledger first, then the ledger, atomically. A folder with a ledger is an authority.
One with the mark `founding` and no ledger was left by a killed `init`. Nobody has seen its content, and it is created
again from the beginning.
"""

from __future__ import annotations

import secrets
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Literal

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.core.paths import require_own
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.vpn import ledger, pki
from atlantis_netcfg.vpn.authority import model
from atlantis_netcfg.vpn.authority.check import Agreement, agreement, problems
from atlantis_netcfg.vpn.authority.ledger_session import (
    HEAD_FILE,
    LedgerSession,
    SigningSession,
    beyond_record,
    names_of,
    new_head,
    new_operation,
    new_server_certificate,
    read_head,
    sign_crl,
    sign_head,
)
from atlantis_netcfg.vpn.authority.signer import Signer
from atlantis_netcfg.vpn.ledger import LedgerEntry, LedgerState, records
from atlantis_netcfg.vpn.ledger.records import FoundingRecord

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from pathlib import Path

    from atlantis_netcfg.vpn import identity


Sealing = Literal["age", "vault"]
UNFINISHED_MARK = "founding"
_OWN_FOLDER_HINT = "run the command as that user, or use a folder of your own: authority=DIR"


def is_complete(folder: Path) -> bool:
    """Return True if the folder has a complete authority."""
    return (folder / ledger.FILE).exists()


def require_authority(folder: Path) -> None:
    """Raise NoAuthority, or CorruptAuthorityError if only the ledger is missing."""
    if is_complete(folder):
        with model.os_errors_as("the authority cannot be read"):
            require_own(folder, _OWN_FOLDER_HINT)
        return
    _check_leftovers(folder)
    raise model.NoAuthority(
        f"there is no authority in {arg(folder)}", hint="`provision vpn init` creates one; `authority=DIR` names it"
    )


def prepare_folder(folder: Path) -> None:
    """Create the folder, accessible by its owner only."""
    with model.os_errors_as("no folder for the authority"):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        require_own(folder, _OWN_FOLDER_HINT)
        runs.sync_directory(folder.parent)
        if folder.stat().st_mode & 0o077:
            folder.chmod(0o700)


def init_authority(folder: Path, passphrase: Secret, names: model.ServerNames, who: str, sealing: Sealing) -> None:
    """Create the authority under the lock; do nothing if it exists. Raises UsageError if it has other names."""
    if is_complete(folder):
        _require_same_names(folder, names)
    else:
        _create_authority(folder, passphrase, names, who, sealing)
    with model.os_errors_as("the authority cannot be completed"):
        model.forget(folder / UNFINISHED_MARK)
        model.sweep(folder)


def seal_ca_key(key: Secret, passphrase: Secret, sealing: Sealing) -> bytes:
    """Return the CA key encrypted for storage. Raises WeakPassphrase."""
    encrypt = pki.seal if sealing == "age" else pki.vault_seal
    return encrypt(key.reveal().encode(), passphrase)


def _create_authority(folder: Path, passphrase: Secret, names: model.ServerNames, who: str, sealing: Sealing) -> None:
    _check_leftovers(folder)
    now = ledger.utc_now()
    # Each authority has a name of its own: OpenVPN takes a list of another CA of the same name with a mere warning.
    ca = pki.new_ca(f"ATLANTIS VPN {secrets.token_hex(4)}", now)
    server, server_record = new_server_certificate(ca, names, now)
    crl, crl_record = sign_crl(ca, (), 1, now)
    files = {
        model.SEALED_KEY_FILES[sealing]: seal_ca_key(pki.key_pem(ca.key), passphrase, sealing),
        model.CA: pki.cert_pem(ca.certificate).encode(),
        **server,
        model.TLS_CRYPT_V2: pki.server_key().reveal().encode(),
        model.TLS_CRYPT: pki.shared_key().reveal().encode(),
        model.CRL: crl,
    }
    founding_record = FoundingRecord(
        ca_common_name=ca.certificate.subject.rfc4514_string().removeprefix("CN="),
        ca_sha256=pki.sha256(ca.certificate),
        ca_not_after=ca.certificate.not_valid_after_utc,
        sealed_by=sealing,
        heads=True,
    )
    lines = ledger.first_lines([founding_record, server_record, crl_record], who, new_operation(), now)
    digests = [ledger.digest(line) for line in lines.splitlines()]
    files[HEAD_FILE] = new_head(ca, len(digests), digests[-1], now)
    with model.os_errors_as("the authority cannot be created"):
        runs.write_atomically(folder / UNFINISHED_MARK, b"provision vpn init was not completed here: run it again\n")
        for other in model.SEALED_KEY_FILES.values():
            (folder / other).unlink(missing_ok=True)
        model.folders(folder)
        for name, data in files.items():
            runs.write_atomically(folder / name, data)
        runs.write_atomically(folder / ledger.FILE, lines)


def _check_leftovers(folder: Path) -> None:
    """Raise CorruptAuthorityError if the files are not those of a killed `init`."""
    if not (folder / UNFINISHED_MARK).exists() and (leftovers := _remains(folder)):
        raise model.CorruptAuthorityError(
            f"{arg(folder)} has {arg(leftovers)}, but no ledger: without it nothing can be issued or revoked",
            hint=f"restore {arg(ledger.FILE)} from your backup of the authority",
        )


def _remains(folder: Path) -> str | None:
    """Return the files in the folder that only an authority has; None if there are none."""
    names = (model.CA, model.CRL, *model.SEALED_KEY_FILES.values())
    present_names = [name for name in names if (folder / name).exists()]
    return join(", ", present_names) or None


def _require_same_names(folder: Path, names: model.ServerNames) -> None:
    server = ledger.LedgerState(ledger.read(folder / ledger.FILE).sound().entries).server
    if server is None or names_of(server) != names:
        server_text = "nothing" if server is None else join(", ", (*server.dns, *map(str, server.addresses)))
        raise UsageError(
            f"{arg(folder)} already has an authority, whose server is {arg(server_text)}: it is not overwritten",
            hint="use another folder: authority=DIR",
        )


def unseal_ca(folder: Path, passphrase: Secret) -> pki.Ca:
    """Return the CA with its key. Raises NoAuthority, WrongPassphrase, CorruptSealError, CorruptAuthorityError."""
    require_authority(folder)
    with model.os_errors_as("the certificate authority cannot be read"):
        certificate = (folder / model.CA).read_text(encoding="ascii")
        sealed_files = {
            sealing: (folder / name).read_bytes()
            for sealing, name in model.SEALED_KEY_FILES.items()
            if (folder / name).exists()
        }
    if not sealed_files:
        raise model.CorruptAuthorityError(
            f"the CA key is missing in {arg(folder)}", hint="restore it from a backup of the authority"
        )
    wrong: Exception | None = None
    # A backup may have put a second one there: either passphrase opens its own.
    for sealing, data in sealed_files.items():
        try:
            pem = pki.unseal(data, passphrase) if sealing == "age" else pki.vault_unseal(data, passphrase)
        except (pki.WrongPassphrase, pki.CorruptSealError, pki.SealTooLarge) as error:
            wrong = error
        else:
            return pki.load_ca(certificate, Secret(pem.decode("ascii")))
    assert wrong is not None  # noqa: S101 - there was one to open
    raise wrong


_DAY = timedelta(days=1)


def observe_sessions(
    state: LedgerState, sightings: Mapping[str, datetime]
) -> tuple[list[records.Record], model.SessionObservation]:
    """Return the new observations as records, and their consequences."""
    members = {state.issued[name].name: None for name in sightings if name in state.issued}
    new: list[records.Record] = []
    withdrawn: list[str] = []
    for name in members:
        member = state.member(name)
        new.extend(_sighting_records(member, sightings))
        withdrawn.extend(
            certificate.common_name
            for certificate in member.certificates
            if _is_seen_after_revocation(certificate, sightings.get(certificate.common_name))
        )
    superseded_names = tuple(item.common_name for item in new if isinstance(item, records.SupersedeRecord))
    strangers = tuple(name for name in sightings if name not in state.issued)
    return new, model.SessionObservation(superseded_names, strangers, tuple(withdrawn))


def _sighting_records(member: identity.Member, sightings: Mapping[str, datetime]) -> Iterator[records.Record]:
    good = member.good
    for item in good:
        last = sightings.get(item.common_name)
        if last is not None and (item.seen is None or last - item.seen >= _DAY):
            yield records.SightingRecord(common_name=item.common_name, last=last)
    in_use = [
        number
        for number, certificate in enumerate(good)
        if certificate.common_name in sightings or certificate.seen is not None
    ]
    for old in good[: max(in_use, default=0)]:
        yield records.SupersedeRecord(common_name=old.common_name, by=good[max(in_use)].common_name)


def _is_seen_after_revocation(certificate: identity.Certificate, last: datetime | None) -> bool:
    return last is not None and certificate.revoked is not None and last > certificate.revoked


class Authority:
    """A folder with a CA, its ledger, and derived files. Reading needs no lock and no passphrase."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def exists(cls, folder: Path) -> bool:
        """Return True if the folder has a complete authority."""
        return is_complete(folder)

    @classmethod
    def init(
        cls, folder: Path, passphrase: Secret, server_names: model.ServerNames, who: str, sealed_by: Sealing = "age"
    ) -> Authority:
        """Create an authority: CA, server certificate, tls-crypt keys, an empty revocation list.

        If killed at any moment, the repeat starts anew. A complete one is never overwritten: it is returned if it was
        created with the same names, else UsageError.
        """
        prepare_folder(folder)
        with model.Lock(folder, who):
            init_authority(folder, passphrase, server_names, who, sealed_by)
        return cls(folder)

    @classmethod
    def open(cls, folder: Path) -> Authority:
        """Return the authority of a folder. Raises NoAuthority."""
        require_authority(folder)
        return cls(folder)

    def membership(self) -> identity.MembershipList:
        """Return the members of the VPN. Raises CorruptLedgerError."""
        return self._state().membership()

    def history(self) -> tuple[LedgerEntry, ...]:
        """Return every entry of the ledger, oldest first. Raises CorruptLedgerError."""
        return ledger.read(self.folder / ledger.FILE).sound().entries

    def server(self) -> model.ServerNames:
        """Return the names in the server's certificate. Raises CorruptLedgerError."""
        server = self._state().server
        if server is None:
            raise model.CorruptAuthorityError("the ledger contains no server", hint="restore the ledger from a backup")
        return names_of(server)

    def opening_bytes(self) -> int:
        """Return the memory needed to open the CA key; 0 if negligible."""
        with model.os_errors_as("the CA key cannot be read"):
            path = self.folder / model.SEALED_KEY_FILES["age"]
            return pki.opening_bytes(path.read_bytes()) if path.exists() else 0

    def crl(self) -> bytes:
        """Return the published revocation list, PEM.

        Raises InvalidCrlError if no server may use it, CorruptAuthorityError if it is not the recorded one.
        """
        with model.os_errors_as("the revocation list cannot be read"):
            pem = (self.folder / model.CRL).read_bytes()
            ca = pki.load_cert((self.folder / model.CA).read_text(encoding="ascii"))
        facts = pki.check_crl(pem, ca, above=None, now=ledger.utc_now())
        if facts.sha256 != self.membership().crl_sha256:
            raise model.CorruptAuthorityError(
                f"{arg(model.CRL)} (number {arg(facts.number)}) is not the revocation list that was recorded last",
                hint="`provision vpn sync --sign` signs a new one",
            )
        return pem

    def beyond(self, pem: bytes) -> str | None:
        """Describe what a server's list contains beyond this record; None: nothing, or it is another CA's list."""
        with model.os_errors_as("the certificate authority cannot be read"):
            ca = pki.load_cert((self.folder / model.CA).read_text(encoding="ascii"))
        return beyond_record(self.folder, self._state(), ca, pem)

    def check(self, now: datetime | None = None) -> list[str]:
        """Return the problems as text: ledger, certificates, list, expiries; never raises for a problem."""
        return list(problems(self.folder, ledger.utc_now() if now is None else now))

    def agreement(self) -> Agreement:
        """Compare the record with its signature, the certificates and the list. Raises CorruptLedgerError."""
        return agreement(self.folder)

    @contextmanager
    def unlock(
        self,
        passphrase: Callable[[], Secret],
        who: str,
        *,
        waiting: Callable[[str], None] | None = None,
        trust_clock: bool = False,
    ) -> Iterator[Signer]:
        """Open a signing session. One process at a time: waits up to 60 s, calling `waiting` once with the holder.

        What a killed command left is completed or withdrawn first. `trust_clock`: sign although the clock is before the
        last record, because that record's time was wrong. Raises WrongPassphrase, AuthorityBusy, CorruptLedgerError,
        ClockBehind, AuthorityError.
        """
        # Asked and opened before the lock: nobody waits for somebody who looks for the note with the passphrase.
        ca = unseal_ca(self.folder, passphrase())
        with self._open_for_signing(ca, who, waiting=waiting, trust_clock=trust_clock) as signer:
            yield signer

    @contextmanager
    def _open_for_signing(
        self, ca: pki.Ca, who: str, *, waiting: Callable[[str], None] | None = None, trust_clock: bool = False
    ) -> Iterator[Signer]:
        with self._open_for_writing(who, waiting) as (ledger_session, was_killed):
            if ledger_session.state.founded is None or ledger_session.state.founded.ca_sha256 != pki.sha256(
                ca.certificate
            ):
                raise model.CorruptAuthorityError(
                    f"{arg(model.CA)} is not the certificate authority of the ledger",
                    hint="restore both from the same backup of the authority",
                )
            read_head(self.folder, ca.certificate, ledger_session.state).hold(ledger_session.digests)
            ledger_session.check_clock(is_trusted=trust_clock)
            session = SigningSession(self.folder, ledger_session, ca)
            session.recover(was_killed=was_killed)
            try:
                yield Signer(session)
            except BaseException:
                # Best effort: the next command that signs does it.
                with suppress(NetcfgError):
                    sign_head(self.folder, ledger_session, ca)
                raise
            sign_head(self.folder, ledger_session, ca)

    @contextmanager
    def _open_for_writing(
        self, who: str, waiting: Callable[[str], None] | None = None
    ) -> Iterator[tuple[LedgerSession, bool]]:
        require_authority(self.folder)
        with ExitStack() as exit_stack:
            lock = exit_stack.enter_context(model.Lock(self.folder, who or _user_at_host(), waiting))
            yield exit_stack.enter_context(LedgerSession(self.folder, who or _user_at_host())), lock.left

    def record_sessions(self, sightings: Mapping[str, datetime], who: str = "") -> model.SessionObservation:
        """Record the common names with sessions on the server, and when last; older certificates are superseded.

        Recorded are new names, and a later time after a day has passed: the server keeps the exact times.
        """
        if not observe_sessions(self._state(), sightings)[0]:
            return observe_sessions(self._state(), sightings)[1]
        with self._open_for_writing(who) as (ledger_session, _):
            new, answer = observe_sessions(ledger_session.state, sightings)
            ledger_session.write(new, new_operation())
        return answer

    def confirm_revocations(self, common_names: Iterable[str], who: str = "") -> None:
        """Record the server's confirmation that these revoked certificates have no session and are refused."""
        name_set = set(common_names)
        if not name_set.intersection(self.membership().queued_names):
            return
        with self._open_for_writing(who) as (ledger_session, _):
            out = [entry for entry in ledger_session.state.membership().queued_names if entry in name_set]
            ledger_session.write([records.SettlementRecord(common_name=item) for item in out], new_operation())

    def _state(self) -> ledger.LedgerState:
        return ledger.LedgerState(self.history())


def _user_at_host() -> str:
    holder = runs.LockHolder.me("")
    return f"{holder.user}@{holder.host}"
