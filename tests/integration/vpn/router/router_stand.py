"""A site's router as a twin of some version, and an identity for it."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from atlantis_netcfg.emulator.routeros import RouterLink, RunningSite
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.operations.common.request import Request, Target
from atlantis_netcfg.operations.vpn.router import InstalledIdentity, install
from atlantis_netcfg.vpn.identity import Identity
from atlantis_netcfg.vpn.rehearsal import rehearsed_identity

SHIPPED = load(Path(__file__).parents[4] / "inventory")
HOST = SHIPPED.hosts["coastal-router"]


@dataclass
class Stand:
    """The twin that runs, and what the laptop knows."""

    twins: RunningSite
    request: Request
    identity: Identity

    def install(self, identity: Identity | None = None, **how: Any) -> InstalledIdentity:  # noqa: ANN401 - of `install`
        return install(SHIPPED, HOST, identity or self.identity, self.request, **how)

    def rows(self, menu: str) -> list[Mapping[str, str]]:
        """What a technician sees, the newest first where that matters to nobody."""
        said = self.twins.do(HOST.name, "console", words=[f"{menu}/print"])
        return [dict(word[1:].partition("=")[::2] for word in words) for kind, *words in said if kind == "!re"]

    def interface(self) -> Mapping[str, str]:
        (row,) = self.rows("/interface/ovpn-client")
        return row

    def export(self) -> str:
        lines = str(self.twins.do(HOST.name, "export")).splitlines()
        return "\n".join(line for line in lines if not line.startswith("#"))


@contextmanager
def router(tmp_path: Path, version: str = "7.18.2", **more: Any) -> Iterator[Stand]:  # noqa: ANN401 - fields of RouterSpec
    spec = site_spec(SHIPPED, [HOST])
    (twin,) = spec.emulators
    changed = {"router": twin.router.model_copy(update={"version": version, "certificates": ("atlantis-api",), **more})}
    quick = twin.model_copy(update={**changed, "link": RouterLink()})
    (tmp_path / "twins").mkdir()
    with RunningSite(spec.model_copy(update={"emulators": (quick,)}), tmp_path / "twins") as running:
        ready = running.ready[HOST.name]
        target = Target(
            host=ready["host"], port=ready["api_ssl"], pin=ready["pin"], ssh=ready["ssh"], host_key=ready["host_key"]
        )
        request = Request(
            state=tmp_path / "state", rehearsed=True, targets={HOST.name: target}, command="provision vpn"
        )
        yield Stand(running, request, rehearsed_identity(SHIPPED, HOST))
