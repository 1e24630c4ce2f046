"""The real site's ears: each question goes to the place where its thing is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import Place, Trouble
from atlantis_netcfg.checklist.runner._gateway import ask_gateway, in_words
from atlantis_netcfg.checklist.runner._laptop import ask_here
from atlantis_netcfg.checklist.runner._router import Routers
from atlantis_netcfg.checklist.runner.no_result import all_unanswered
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.events import Event, Stage, ignore
from atlantis_netcfg.operations.computers._access import is_gateway
from atlantis_netcfg.operations.request import refuse_examples

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.probes import Answer
    from atlantis_netcfg.checklist.runner._ears import Asked, Heard
    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.operations.request import Request

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

    async def ask(self, place: Place, host: str | None, questions: Asked, result: Heard) -> Mapping[str, Answer]:
        """Ask all questions of one place in one turn; see `Ears.ask`."""
        name = self._name(place, host)
        self.notify(Event(name, Stage.CONNECTING, f"{len(questions)} questions, which only read"))
        try:
            answers = await self._ask(place, host, questions, result)
        except NetcfgError as why:
            self.notify(Event(name, Stage.FAILED, str(why)))
            return all_unanswered(questions, in_words(why))
        if place is not Place.ROUTER:  # whose sessions tell by themselves
            silent = sum(answer.trouble is Trouble.NO_PLACE for answer in answers.values())
            stage = Stage.FAILED if silent else Stage.DONE
            self.notify(Event(name, stage, f"{len(answers) - silent} of {len(answers)} questions were asked"))
        return answers

    async def _ask(self, place: Place, host: str | None, questions: Asked, result: Heard) -> Mapping[str, Answer]:
        if place is Place.LAPTOP:
            return await ask_here(questions, result)
        if place is Place.GATEWAY:
            gateway = next(filter(is_gateway, self.declaration.site_hosts(self.site)), None)
            if gateway is None:
                return all_unanswered(questions, f"{self.site} has no gateway computer")
            return await ask_gateway(self.declaration, gateway, self.request, questions, result, self.ssh_config)
        refuse_examples(self.declaration, rehearsed=self.request.rehearsed)
        routers = Routers(self.declaration, self.site, self.request, self.notify)
        return await (routers.links(questions, result) if host is None else routers.ask(host, questions))

    def _name(self, place: Place, host: str | None) -> str:
        names = {
            Place.LAPTOP: "this computer",
            Place.GATEWAY: f"{self.site}: gateway",
            Place.ROUTER: f"{self.site}: links",
        }
        return host or names[place]
