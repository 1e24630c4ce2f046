"""The folder of the authority, as every command opens it."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from datetime import datetime
    from pathlib import Path

    from atlantis_netcfg.secret import Secret
    from atlantis_netcfg.vpn.authority._signer import Signer
    from atlantis_netcfg.vpn.authority._types import Delivered, ServerNames, Sighting
    from atlantis_netcfg.vpn.identity import Roll
    from atlantis_netcfg.vpn.ledger import Entry

__all__ = ["Authority"]


class Authority:
    """A folder with a CA, its ledger, and what follows from it. Reading takes no lock and no passphrase."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @classmethod
    def exists(cls, folder: Path) -> bool:
        """Whether the folder has a complete authority."""
        raise NotImplementedError

    @classmethod
    def init(
        cls,
        folder: Path,
        passphrase: Secret,
        wish: ServerNames,
        who: str,
        sealed_by: Literal["age", "vault"] = "age",
    ) -> Authority:
        """Found an authority: CA, server certificate, tls-crypt keys, an empty list.

        Killed at any moment, the repeat begins anew; a complete one is never overwritten: it is returned if it was
        founded with the same names, else UsageError.
        """
        raise NotImplementedError

    @classmethod
    def open(cls, folder: Path) -> Authority:
        """The authority of a folder. Raises NoAuthority."""
        raise NotImplementedError

    def roll(self) -> Roll:
        """Who is in the VPN. Raises LedgerDamaged."""
        raise NotImplementedError

    def history(self) -> tuple[Entry, ...]:
        """Every entry of the ledger, oldest first. Raises LedgerDamaged."""
        raise NotImplementedError

    def server(self) -> ServerNames:
        """What the server's certificate is made out to."""
        raise NotImplementedError

    def crl(self) -> bytes:
        """The published list, PEM; AuthorityDamaged if it is not the one that the record names, or has expired."""
        raise NotImplementedError

    def check(self) -> list[str]:
        """Problems, in words: ledger, certificates, list, expiries; never raises for what it finds."""
        raise NotImplementedError

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
        raise NotImplementedError
        yield

    def seen(self, sightings: Mapping[str, datetime], who: str = "") -> Sighting:
        """Record which common names the server had sessions of, and when last; an older certificate is superseded."""
        raise NotImplementedError

    def settled(self, common_names: Iterable[str], who: str = "") -> None:
        """Record that the server confirmed: these revoked certificates have no session and get none."""
        raise NotImplementedError

    def delivered(self, common_name: str, delivered: Delivered, who: str = "") -> None:
        """Record that a member's file was made out or handed over once more."""
        raise NotImplementedError

    def reseal(self, old: Secret, new: Secret, who: str, sealed_by: Literal["age", "vault"] = "age") -> None:
        """Put the CA key under another passphrase."""
        raise NotImplementedError
