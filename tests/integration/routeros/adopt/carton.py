"""A router twin in its box, and the laptop that adopts it: in this process, or in one that can be killed."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from atlantis_netcfg.core.events import Event
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import Device, RouterSpec, RunningSite, SiteSpec
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.operations.adopt import Adoption, AdoptionResult
from atlantis_netcfg.operations.common.rehearsal import factory_spec, site_spec

CHECKOUT = Path(__file__).resolve().parents[4]
ROUTER = "scc-router"
CHANGES = re.compile(" (add|set|remove|sign|disable|enable) ")
"""In a console line that changes something."""
QUICK = {"unroll_delay_s": 0.05, "silent_timeout_s": 2.0}


@cache
def declaration() -> Inventory:
    return load(CHECKOUT / "inventory")


def adopted_export() -> str:
    """What the twin of an adopted router exports."""
    declared = declaration()
    (twin,) = site_spec(declared, [declared.hosts[ROUTER]]).emulators
    return Device(twin.router, lambda: 0.0).export(header=False)


@dataclass(slots=True)
class Carton:
    """The twin, and the state of the laptop."""

    site: RunningSite
    state: Path
    serial: bool = False
    told: list[str] = field(default_factory=list)

    def export(self) -> str:
        return str(self.site.do(ROUTER, "export", header=False))

    def adoption(self, **options: Any) -> Adoption:  # noqa: ANN401 - passed on
        """A fresh run of the command, as a technician would type it again."""
        passwords = options.pop("passwords", ("",))
        adoption = Adoption(
            declaration(),
            declaration().hosts[ROUTER],
            self.state,
            "provision device adopt",
            self._notify,
            lambda: iter(map(Secret, passwords)),
            is_rehearsal=True,
            **{"wait_s": 10.0, **options},
        )
        adoption.locate = self._locate
        if self.serial and "via" not in options:
            adoption.via = f"serial:{self.site.do(ROUTER, 'info')['serial']}"
        return adoption

    def adopt(self, **options: Any) -> AdoptionResult:  # noqa: ANN401 - passed on
        return self.adoption(**options).carry_out(lambda _: None)

    def _notify(self, event: Event) -> None:
        self.told.append(event.message)

    def _locate(self, address: str, port: int) -> tuple[str, int]:
        info = dict(self.site.do(ROUTER, "info"))
        doors = info if address == "10.64.100.1" else info["first_contact"]
        return info["host"], int(doors["ports"].get(str(port), 1))


@contextmanager
def carton(folder: Path, *, serial: bool = False, **changes: Any) -> Iterator[Carton]:  # noqa: ANN401 - of RouterSpec
    """A twin that comes out of its box; `changes` are fields of its spec."""
    declared = declaration()
    spec = factory_spec(declared, declared.hosts[ROUTER], serial=serial)
    router = RouterSpec.model_validate({**spec.router.model_dump(), **QUICK, **changes})
    twins = SiteSpec(name="scc", emulators=(spec.model_copy(update={"router": router}),))
    with RunningSite(twins, folder / "twins") as site:
        yield Carton(site, folder / "state", serial)
