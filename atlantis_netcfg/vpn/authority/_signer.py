"""What is done with the CA key, while its lock is held."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence
    from ipaddress import IPv4Address

    from atlantis_netcfg.vpn.authority._types import Delivered, Issued, Revoked, Wish
    from atlantis_netcfg.vpn.identity import Identity, KeyType, Link, Roll, Wrap

__all__ = ["Signer"]


class Signer:
    """Got by `Authority.unlocked()`; good inside that block only."""

    @property
    def roll(self) -> Roll:
        """The roll as it stands after what this signer has done."""
        raise NotImplementedError

    def issue(
        self,
        wishes: Sequence[Wish],
        deliver: Callable[[Identity], Delivered],
        *,
        reserved: Collection[IPv4Address] = (),
    ) -> tuple[Issued, ...]:
        """Make members, all checked before the first is made; answers are in the order of the wishes.

        `deliver` is called when the certificate is recorded, and writes the file atomically, 0600. `reserved` are
        addresses that are not given away: the server's own, and those of declared hosts. UsageError for a name that is
        refused or taken, for a member of this name that is not the one wished for, for an address in use.
        """
        raise NotImplementedError

    def renew(
        self,
        name: str,
        deliver: Callable[[Identity], Delivered],
        *,
        days: int | None = None,
        wrap: Wrap | None = None,
        key: KeyType | None = None,
        link: Link | None = None,
        request_id: str = "",
    ) -> Issued:
        """Give a member a successor `NAME.2`, `NAME.3` …; the certificate in use works until the new one was seen.

        Successors that were handed out before and never seen are revoked (`Issued.replaced`).
        None: as its newest certificate has it.
        """
        raise NotImplementedError

    def revoke(self, names: Sequence[str], reason: str) -> Revoked:
        """Revoke every certificate of these members, and publish the list. The names never return.

        Once more for members that are revoked: nothing new is recorded, the answer is the same.
        """
        raise NotImplementedError

    def publish(self) -> bytes:
        """Sign the list anew, superseded certificates on it as well; PEM."""
        raise NotImplementedError
