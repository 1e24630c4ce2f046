"""The real site's ears: each question goes to the place where its thing is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.events import ignore

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.events import Subscriber
    from atlantis_netcfg.operations.checking._ears import Asked, Heard
    from atlantis_netcfg.operations.request import Request
    from atlantis_netcfg.probes import Answer, Place
    from atlantis_netcfg.site import Declaration

__all__ = ["RealEars"]


@dataclass(slots=True)
class RealEars:
    """Asks the devices of a site. Links that are paid by the byte carry nothing without `request.accept_cost`."""

    declaration: Declaration
    site: str
    request: Request
    notify: Subscriber = ignore
    ssh_config: str | None = None
    """File of OpenSSH that says how the gateway's name is reached, in place of the declared address."""

    async def ask(self, place: Place, host: str | None, questions: Asked, heard: Heard) -> Mapping[str, Answer]:
        """Ask all questions of one place in one turn; see `Ears.ask`."""
        raise NotImplementedError
