"""First contact with one end of a Wi-Fi bridge: one port, so that the laptop changes its address and not its socket."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from carton import QUICK, declaration

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import Device, RouterSpec, RunningSite, SiteSpec
from atlantis_netcfg.operations.adopt import Adoption, AdoptionResult
from atlantis_netcfg.operations.common.rehearsal import factory_spec, site_spec
from atlantis_netcfg.routeros.first_contact.run import PreflightError

pytestmark = pytest.mark.slow
CPE, ADDRESS = "coastal-cpe", "10.10.0.4"


class Box:
    """A CPE's twin as it comes out of its box."""

    def __init__(self, site: RunningSite, state: Path) -> None:
        self.site = site
        self.state = state
        self.told: list[str] = []

    def export(self) -> str:
        return str(self.site.do(CPE, "export", header=False))

    def adopt(self) -> AdoptionResult:
        declared = declaration()
        adoption = Adoption(
            declared,
            declared.hosts[CPE],
            self.state,
            "provision device adopt",
            lambda event: self.told.append(event.message),
            lambda: iter([Secret("")]),
            is_rehearsal=True,
            wait_s=10.0,
        )
        adoption.locate = self._locate
        return adoption.carry_out(lambda _: None)

    def _locate(self, address: str, port: int) -> tuple[str, int]:
        info = dict(self.site.do(CPE, "info"))
        doors = info if address == ADDRESS else info["first_contact"]
        return info["host"], int(doors["ports"].get(str(port), 1))


@contextmanager
def boxed(folder: Path, **changes: Any) -> Iterator[Box]:  # noqa: ANN401 - of RouterSpec
    declared = declaration()
    spec = factory_spec(declared, declared.hosts[CPE])
    router = RouterSpec.model_validate({**spec.router.model_dump(), **QUICK, **changes})
    twins = SiteSpec(name="coastal", emulators=(spec.model_copy(update={"router": router}),))
    with RunningSite(twins, folder / "twins") as site:
        yield Box(site, folder / "state")


def adopted(**changes: Any) -> str:  # noqa: ANN401 - of RouterSpec
    """What the twin of an adopted CPE exports."""
    declared = declaration()
    (twin,) = site_spec(declared, [declared.hosts[CPE]]).emulators
    router = RouterSpec.model_validate({**twin.router.model_dump(), **changes})
    return Device(router, lambda: 0.0).export(header=False)


def test_factory_cpe_is_adopted_and_second_adoption_changes_nothing(tmp_path: Path) -> None:
    with boxed(tmp_path) as box:
        assert "mode=station" not in adopted()
        assert "disabled=no" in box.export()
        result = box.adopt()
        assert (result.status, result.exit) == ("changed", ExitCode.DONE)
        assert "plug the laptop into ether1, with address 10.10.0.6/29" in " ".join(box.told)
        after = box.export()
        # The radio keeps the name that it had in the box, and is off.
        assert [line for line in after.splitlines() if line not in adopted().splitlines()] == []
        again = box.adopt()
        assert (again.status, box.export()) == ("unchanged", after)


def test_radio_of_the_new_driver_is_disabled_too(tmp_path: Path) -> None:
    newer = {"packages": ("routeros", "wifi-qcom"), "radios": ({"name": "wifi1"},)}
    with boxed(tmp_path, **newer) as box:
        assert "disabled=no" in box.export()
        assert box.adopt().status == "changed"
        assert "disabled=no" not in box.export().partition("/interface wifi")[2].partition("\n/")[0]


def test_cpe_without_a_radio_driver_is_refused_unchanged(tmp_path: Path) -> None:
    with boxed(tmp_path, packages=("routeros",)) as box:
        before = box.export()
        with pytest.raises(PreflightError, match=r"since 7\.13 `wireless` is a separate package"):
            box.adopt()
        assert box.export() == before
