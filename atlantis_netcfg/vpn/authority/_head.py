"""The signed head of the record: its last line, as it was when a command had the CA key open.

The chain of the ledger's lines needs no key: whoever may write the file can make the chain anew, or leave its end away.
A head cannot be made without the key. After it stand lines that are written without one: who was seen, who is out.

An authority that an older version founded has no head until a command opens its CA key. Who cuts off its lines before
that is found by the certificates, the list and the server alone; who does so later has to remove the head as well, and
every line since, which puts back an old copy: the server tells that.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

from cryptography.exceptions import UnsupportedAlgorithm

from atlantis_netcfg.journal import write_atomically
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority._errors import AuthorityDamaged, os_errors_as

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cryptography import x509

    from atlantis_netcfg.vpn.authority._book import LedgerSession
    from atlantis_netcfg.vpn.ledger import LedgerState

__all__ = ["HEAD_FILE", "NONE_SIGNED", "Head", "new_head", "read_head", "sign_head"]

HEAD_FILE = "ledger.head"
NONE_SIGNED = "nothing says how long the ledger was: an older version founded this authority, and signed no end of it"
_RESTORE = "sign nothing; restore ledger.jsonl and ledger.head from the newest backup of the authority, both of one"
_WHAT = b"head of the record of an ATLANTIS VPN authority\n"
"""Before what is signed: nobody can take it for a certificate or a list."""


@dataclass(frozen=True, slots=True)
class Head:
    """What was signed last."""

    line: int
    digest: str
    """SHA-256 of that line, and by the chain of all before it."""
    at: datetime

    def hold(self, digests: Sequence[str]) -> None:
        """Raise AuthorityDamaged unless these lines begin with those that were signed."""
        on = f"{self.at:%Y-%m-%d %H:%M} UTC"
        if len(digests) < self.line:
            raise AuthorityDamaged(
                f"the ledger has {len(digests)} lines, and {self.line} were signed on {on}: its end is missing, or it "
                "is an old copy",
                hint=_RESTORE,
            )
        if self.line and digests[self.line - 1] != self.digest:
            raise AuthorityDamaged(
                f"the first {self.line} lines of the ledger are not those that were signed on {on}", hint=_RESTORE
            )


_NONE = Head(0, "", datetime.min.replace(tzinfo=UTC))


def new_head(ca: pki.Ca, line: int, digest: str, at: datetime) -> bytes:
    """The file of such a head."""
    values = {"line": line, "sha256": digest, "at": at.isoformat()}
    signature = base64.b64encode(pki.sign(ca.key, _text(values))).decode("ascii")
    return json.dumps({**values, "signature": signature}).encode() + b"\n"


def sign_head(folder: Path, book: LedgerSession, ca: pki.Ca) -> None:
    """Sign the last line, unless that was done. Raises AuthorityFailed."""
    line = len(book.digests)
    if read_head(folder, ca.certificate, book.fold).line < line:
        with os_errors_as("the head of the record cannot be written"):
            write_atomically(folder / HEAD_FILE, new_head(ca, line, book.digests[-1], book.now()))


def read_head(folder: Path, ca: x509.Certificate, fold: LedgerState) -> Head:
    """The head of a folder; of no line where an older version founded it. Raises AuthorityDamaged, AuthorityFailed."""
    with os_errors_as("the head of the record cannot be read"):
        try:
            data = (folder / HEAD_FILE).read_bytes()
        except FileNotFoundError:
            if fold.founded is not None and not fold.founded.heads:
                return _NONE
            raise AuthorityDamaged(
                f"{HEAD_FILE} is missing: nothing says how long the ledger was", hint=_RESTORE
            ) from None
    try:
        key = ca.public_key()
        result = json.loads(data)
        signature = base64.b64decode(result.pop("signature"), validate=True)
        head = Head(int(result["line"]), str(result["sha256"]), datetime.fromisoformat(result["at"]))
        # Somebody else's CA may have a key of another kind than ours.
        signed = isinstance(key, pki.PublicKey) and pki.is_signed(key, _text(result), signature) and head.line > 0
    except (ValueError, KeyError, TypeError, AttributeError, UnsupportedAlgorithm):
        signed = False
    if not signed:
        raise AuthorityDamaged(f"{HEAD_FILE} is not signed by this authority: it was changed", hint=_RESTORE)
    return head


def _text(values: dict[str, object]) -> bytes:
    return _WHAT + json.dumps(values, sort_keys=True, separators=(",", ":")).encode()
