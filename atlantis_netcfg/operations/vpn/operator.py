"""Who works on the authority, and how: the same for every command that signs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.vpn.authority import Authority, Signer

__all__ = ["OperatorContext"]


@dataclass(frozen=True, slots=True)
class OperatorContext:
    """A person before the authority."""

    authority: Authority
    who: str
    """For the record."""
    waiting: Callable[[str], None]
    """Is told for whom the command waits, if it does."""
    trust_clock: bool = False
    """A person has said that this computer's clock is right, although the record's last entry is later."""

    def unlocked(self, passphrase: Callable[[], Secret]) -> AbstractContextManager[Signer]:
        """Sign, as `Authority.unlocked` has it."""
        return self.authority.unlocked(passphrase, self.who, waiting=self.waiting, trust_clock=self.trust_clock)
