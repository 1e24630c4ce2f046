"""What signing needs: the folder, the ledger open for writing, the CA with its key; held under the lock.

Also the server's certificate and key, which are made and checked with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from functools import cached_property
from typing import TYPE_CHECKING

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.journal import write_atomically
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority import files
from atlantis_netcfg.vpn.authority.ledger_session import new_operation
from atlantis_netcfg.vpn.authority.model import ServerNames, os_errors_as
from atlantis_netcfg.vpn.authority.revocation_list import is_crl_due, publish_crl
from atlantis_netcfg.vpn.identity import KeyType, Wrap
from atlantis_netcfg.vpn.ledger.records import Begun, Committed, RolledBack, ServerIssued

if TYPE_CHECKING:
    from datetime import datetime
    from pathlib import Path

    from atlantis_netcfg.vpn.authority.ledger_session import LedgerSession


SOON = timedelta(days=90)
"""With less than this until its end, whoever asks for a new one gets it."""


def new_server_certificate(ca: pki.Ca, names: ServerNames, now: datetime) -> tuple[dict[str, bytes], ServerIssued]:
    """A key and a certificate as files, and their record."""
    key = pki.new_key(KeyType.EC)
    certificate = pki.new_server(
        ca, key.public_key(), names.common_name, names.dns, names.addresses, pki.new_serial(), now
    )
    record = ServerIssued(
        common_name=names.common_name,
        dns=names.dns,
        addresses=names.addresses,
        serial=certificate.serial_number,
        sha256=pki.sha256(certificate),
        not_before=certificate.not_valid_before_utc,
        not_after=certificate.not_valid_after_utc,
    )
    written = {
        files.SERVER_KEY: pki.key_pem(key).reveal().encode(),
        files.SERVER_CERT: pki.cert_pem(certificate).encode(),
    }
    return written, record


def names_of(record: ServerIssued) -> ServerNames:
    """The names that it is issued for."""
    return ServerNames(record.common_name, record.dns, record.addresses)


def needs_another(record: ServerIssued | None, names: ServerNames, now: datetime) -> bool:
    """Whether the one that is recorded is for other names, or ends soon."""
    return record is None or names_of(record) != names or record.not_after - now < SOON


def is_sound(folder: Path, record: ServerIssued) -> bool:
    """Whether the files are the recorded certificate and its key: they are written one after the other."""
    try:
        certificate = pki.load_cert((folder / files.SERVER_CERT).read_text(encoding="ascii"))
        key = pki.load_key(Secret((folder / files.SERVER_KEY).read_text(encoding="ascii")))
    except (FileNotFoundError, ValueError, pki.KeyDamaged):
        return False
    return pki.sha256(certificate) == record.sha256 and certificate.public_key() == key.public_key()


@dataclass(frozen=True)
class SigningSession:
    """What a command that signs works with; one per command."""

    folder: Path
    ledger: LedgerSession
    ca: pki.Ca

    @cached_property
    def ca_pem(self) -> str:
        """The CA's certificate."""
        return pki.cert_pem(self.ca.certificate)

    def wrap_key(self, wrap: Wrap, common_name: str) -> Secret:
        """Key of a member's control channel."""
        if wrap is Wrap.TLS_CRYPT:
            return self._shared
        return pki.client_key(self._server, f"cn={common_name}".encode())

    def publish(self, operation: str, also: pki.CrlFacts | None = None) -> bytes:
        """Put a list in place that says what the record says, and what a list says that is taken over."""
        return publish_crl(self.folder, self.ledger, self.ca, operation, also)

    def serve(self, names: ServerNames) -> None:
        """Make the server a new key and certificate."""
        operation = new_operation()
        written, record = new_server_certificate(self.ca, names, self.ledger.now())
        self.ledger.write([Begun(command="serve"), record], operation)
        with os_errors_as("the server's certificate cannot be written"):
            for name, data in written.items():
                write_atomically(self.folder / name, data)
        self.ledger.write([Committed()], operation)

    def recover(self, *, left: bool) -> None:
        """Finish or withdraw what commands before this one left; `left`: the last one was killed.

        What is wrong is found by looking, not by remembering: this may be killed as well.
        """
        with os_errors_as("the authority cannot be put in order"):
            if left or self.ledger.state.open:
                files.sweep(self.folder)
            files.folders(self.folder)
            for operation in tuple(self.ledger.state.open):
                self.ledger.write([self._end(operation)], operation)
            files.restore_copies(self.folder, self.ledger.state.issued.values())
            of = self.ledger.state.server
            whole = of is None or is_sound(self.folder, of)
        if of is not None and not whole:
            self.serve(names_of(of))
        if is_crl_due(self.folder, self.ledger, self.ca):
            self.publish(new_operation())

    def _end(self, operation: str) -> Committed | RolledBack:
        state = self.ledger.state
        lost = tuple(name for name, of in state.pending.items() if of == operation)
        whole = state.done[operation].issuperset(state.open[operation].names)
        return Committed() if whole and not lost else RolledBack(common_names=lost)

    @cached_property
    def _server(self) -> Secret:
        return self._secret(files.TLS_CRYPT_V2)

    @cached_property
    def _shared(self) -> Secret:
        return self._secret(files.TLS_CRYPT)

    def _secret(self, name: str) -> Secret:
        with os_errors_as("a key of the server cannot be read"):
            return Secret((self.folder / name).read_text(encoding="ascii"))
