"""How the making or the opening of a bundle ends when it does not succeed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["BundleRefused", "refused"]


class BundleRefused(UsageError):
    """A bundle that cannot be made, or must not be used; nothing was contacted. `errors` are told one by one."""

    def __init__(self, message: str, *, hint: str | None = None, errors: Sequence[BundleRefused] = ()) -> None:
        super().__init__(message, hint=hint)
        self.errors = tuple(errors)


def refused(found: Sequence[tuple[str, str | None]]) -> BundleRefused:
    """One error for all that was found: pairs of message and hint."""
    rows = [BundleRefused(message, hint=hint) for message, hint in found]
    return BundleRefused("\n".join(str(row) for row in rows), hint=rows[-1].hint, errors=rows)
