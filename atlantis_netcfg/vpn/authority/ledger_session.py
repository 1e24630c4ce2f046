"""The ledger while it is written to, and its signed head: its last line when a command last had the CA key open.

The chain of the ledger's lines needs no key: whoever may write the file can make a new chain, or remove its end. A head
cannot be made without the key. Lines that are written without a key stand after it: who was seen, who is out.

An authority that an older version founded has no head until a command opens its CA key. If lines are cut off before
that, only the certificates, the list and the server show it. Whoever cuts lines off later must also remove the head and
every line since, which restores an old copy: the server shows that.
"""

from __future__ import annotations

import base64
import json
import secrets
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Self

from cryptography.exceptions import UnsupportedAlgorithm

from atlantis_netcfg.journal import write_atomically
from atlantis_netcfg.vpn import pki
from atlantis_netcfg.vpn.authority.model import AuthorityDamaged, ClockBehind, os_errors_as
from atlantis_netcfg.vpn.ledger import FILE, Ledger, LedgerState, utc_now
from atlantis_netcfg.vpn.ledger.records import ClockTrusted

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from cryptography import x509

    from atlantis_netcfg.vpn.ledger import Record


SLACK = timedelta(minutes=2)
"""So far a clock may be set back by a time server: records of that while bear the time of the last one."""


class LedgerSession:
    """Opened by the one who holds the lock. Raises LedgerDamaged, LedgerFailed."""

    def __init__(self, folder: Path, who: str) -> None:
        self._ledger = Ledger(folder / FILE)
        self._who = who
        self.state = LedgerState(self._ledger.entries)

    @property
    def usable(self) -> bool:
        """Whether it can still be written to."""
        return self._ledger.usable

    @property
    def digests(self) -> Sequence[str]:
        """Hash of each line."""
        return self._ledger.digests

    def now(self) -> datetime:
        """The time for what is recorded and signed: this computer's, and never before the last record."""
        now = utc_now()
        return now if self.state.last is None else max(now, self.state.last)

    def check_clock(self, *, trusted: bool) -> None:
        """Raise ClockBehind if the clock stands before the last record; `trusted`: record that it is right."""
        now, last = utc_now(), self.state.last
        if last is None or now >= last - SLACK:
            return
        if not trusted:
            raise ClockBehind(
                f"this computer's clock says {now:%Y-%m-%d %H:%M} UTC, and the last record of the authority is of "
                f"{last:%Y-%m-%d %H:%M} UTC: what is signed now could be refused, or end too early",
                hint="set the clock, then run the same command again; if the clock is right and was wrong before: "
                "add clock=right",
            )
        self._apply([ClockTrusted(before=last)], new_operation(), now)

    def write(self, records: Sequence[Record], operation: str) -> None:
        """Put records on disk, all or none as far as a disk can. Raises LedgerFailed."""
        self._apply(records, operation, self.now())

    def close(self) -> None:
        """Nothing is pending."""
        self._ledger.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _apply(self, records: Sequence[Record], operation: str, now: datetime) -> None:
        for entry in self._ledger.write(records, self._who, operation, now):
            self.state.apply(entry)


def new_operation() -> str:
    """What the records of one command have in common."""
    return secrets.token_hex(6)


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


def sign_head(folder: Path, ledger_session: LedgerSession, ca: pki.Ca) -> None:
    """Sign the last line, unless that was done. Raises AuthorityFailed."""
    line = len(ledger_session.digests)
    if read_head(folder, ca.certificate, ledger_session.state).line < line:
        with os_errors_as("the head of the record cannot be written"):
            write_atomically(folder / HEAD_FILE, new_head(ca, line, ledger_session.digests[-1], ledger_session.now()))


def read_head(folder: Path, ca: x509.Certificate, state: LedgerState) -> Head:
    """The head of a folder; of no line where an older version founded it. Raises AuthorityDamaged, AuthorityFailed."""
    with os_errors_as("the head of the record cannot be read"):
        try:
            data = (folder / HEAD_FILE).read_bytes()
        except FileNotFoundError:
            if state.founded is not None and not state.founded.heads:
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
