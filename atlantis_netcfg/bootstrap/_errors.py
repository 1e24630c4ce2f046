"""How first contact can end short of its goal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed, OutcomeUnknown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.bootstrap._preflight import Objection

__all__ = ["CutOff", "NotFactoryFresh", "PreflightRefused", "StillToMove", "Unfinished"]


class PreflightRefused(DeviceFailed):
    """The device cannot become what is declared; nothing was touched. `errors` are all the reasons."""

    def __init__(self, objections: Sequence[Objection]) -> None:
        super().__init__("; ".join(one.message for one in objections))
        self.errors = tuple(DeviceFailed(one.message, hint=one.hint) for one in objections)


class NotFactoryFresh(DeviceFailed):
    """Somebody has configured the device; nothing was touched."""


class StillToMove(DeviceFailed):
    """All is ready beside the old way in; nobody has come over the new one yet."""


class Unfinished(DeviceFailed):
    """The device did not reach the adopted state although every command was accepted."""


class CutOff(OutcomeUnknown):
    """The connection was lost in the middle; first contact may be repeated."""
