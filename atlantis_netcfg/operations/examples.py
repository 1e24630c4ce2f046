"""Example values lead to nobody's devices: every door that contacts a device asks here first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Declaration

__all__ = ["refuse_examples"]


def refuse_examples(declaration: Declaration, *, rehearsed: bool) -> None:
    """Raise UsageError if devices of an inventory that still holds example values are to be contacted."""
    if declaration.pilot.example_values and not rehearsed:
        raise UsageError(
            "the inventory still holds example values, which lead to nobody's devices: only a rehearsal may use them",
            hint="replace them and set `example_values: false` in group_vars/all/pilot.yml, or add --rehearse",
        )
