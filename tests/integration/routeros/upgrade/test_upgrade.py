"""Upgrades of a twin over real SSH, whole and broken off."""

import asyncio
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from npk_files import write

from atlantis_netcfg.core.errors import DeviceError, OutcomeUnknown
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import EmulatorSpec, RouterSpec, RunningSite, SiteSpec, User, WireBehaviour
from atlantis_netcfg.operations import upgrade as upgrade_module
from atlantis_netcfg.operations.upgrade import SeenPackages, Upgrading, WaitingUpgrade
from atlantis_netcfg.routeros.api import Endpoint
from atlantis_netcfg.routeros.apply import SshEndpoint
from atlantis_netcfg.routeros.console.types import HostKeyMismatch, UnknownHostKey
from atlantis_netcfg.routeros.packages import UpgradeError, read_npk
from atlantis_netcfg.runs import NoJournal, PackageConfirmation, PackageSent, Rebooting, Record

PASSWORD = "example-password"


class Records(NoJournal):
    """A journal that a test can read; `at` is called before each record is kept."""

    def __init__(self, at: Callable[[Record], None] = lambda _record: None) -> None:
        self.kept: list[Record] = []
        self._at = at

    def write(self, record: Record) -> None:
        self._at(record)
        self.kept.append(record)

    @property
    def kinds(self) -> list[type]:
        return [type(record) for record in self.kept]


@contextmanager
def router(tmp_path: Path, *, boot_s: float = 0.3, **spec: Any) -> Iterator[tuple[RunningSite, Upgrading]]:  # noqa: ANN401
    """A twin of RouterOS 7.18.2 on real sockets, and the upgrade of it to 7.21.5."""
    described = RouterSpec(name="router", users=(User(name="provision", password=PASSWORD),), **spec)
    site = SiteSpec(name="quay", emulators=(EmulatorSpec(router=described, knobs=WireBehaviour(boot_s=boot_s)),))
    (tmp_path / "twins").mkdir()
    with RunningSite(site, tmp_path / "twins") as running:
        ready = running.ready["router"]
        yield (
            running,
            Upgrading(
                "router",
                Endpoint(ready["host"], ready["api_ssl"], "provision", Secret(PASSWORD), ready["pin"]),
                SshEndpoint(ready["host"], ready["ssh"], "provision", Secret(PASSWORD), ready["host_key"]),
                (read_npk(write(tmp_path, "routeros", "7.21.5", "arm64", payload=300_000)),),
                waiting=WaitingUpgrade(until_s=20, poll_s=0.1, connect_s=3),
            ),
        )


def run(upgrading: Upgrading, journal: NoJournal | None = None) -> SeenPackages:
    async def both() -> SeenPackages:
        seen, upgrade = await upgrading.look()
        assert upgrade.send, "there is something to do"
        return await upgrading.carry_out(seen, upgrade, journal or NoJournal())

    return asyncio.run(both())


def state(running: RunningSite) -> str:
    """The configuration without the comment lines, which hold time and version."""
    lines = str(running.do("router", "export")).splitlines()
    return "\n".join(line for line in lines if not line.startswith("#"))


def test_repeated_upgrade_has_nothing_to_send(tmp_path: Path) -> None:
    with router(tmp_path) as (running, upgrading):
        before, journal = state(running), Records()
        back = run(upgrading, journal)
        assert str(back.software.version) == "7.21.5"
        assert [package.name for package in back.software.packages] == ["routeros"]
        assert journal.kinds == [PackageSent, Rebooting, PackageConfirmation]
        assert state(running) == before
        seen, again = asyncio.run(upgrading.look())
        assert again.send == ()
        assert not seen.files, "the device has taken its packages away"


def test_upgrade_requires_packages_for_all_installed_packages(tmp_path: Path) -> None:
    with router(tmp_path, packages=("routeros", "gps")) as (running, upgrading):
        before = running.do("router", "counters")
        with pytest.raises(UpgradeError, match="gps is installed"):
            asyncio.run(upgrading.look())
        assert running.do("router", "counters")["sentences"] > before["sentences"]
        both = (*upgrading.packages, read_npk(write(tmp_path, "gps", "7.21.5", "arm64")))
        back = run(replace(upgrading, packages=both))
        assert {package.name for package in back.software.packages} == {"routeros", "gps"}


def test_unknown_or_changed_host_key_prevents_any_upload(tmp_path: Path) -> None:
    with router(tmp_path) as (running, upgrading):
        for key, refusal in ((None, UnknownHostKey), ("SHA256:" + "A" * 43, HostKeyMismatch)):
            with pytest.raises(refusal):
                run(replace(upgrading, ssh=replace(upgrading.ssh, pin=key)))
        seen, _ = asyncio.run(upgrading.look())
        assert not seen.files
        assert str(seen.software.version) == "7.18.2"
        assert running.do("router", "info")["host_key"] == upgrading.ssh.pin


@pytest.mark.parametrize("fault", ["drop", "gap"])
def test_link_failure_during_upload_leaves_no_files(tmp_path: Path, fault: str) -> None:
    with router(tmp_path) as (running, upgrading):
        before = state(running)
        running.do("router", "link", delay_s=0.0, rate_up_bps=800_000.0)
        struck: list[int] = []

        def notify(event: Any) -> None:  # noqa: ANN401
            if "now routeros" in event.message and event.done_count > 100 and not struck:
                struck.append(event.done_count)
                running.do("router", fault, **({"seconds": 1.5} if fault == "gap" else {}))

        if fault == "gap":
            back = run(replace(upgrading, notify=notify))
            assert str(back.software.version) == "7.21.5", "a gap that the session outlives is only a wait"
        else:
            with pytest.raises(DeviceError, match="was not copied completely"):
                run(replace(upgrading, notify=notify))
            seen, upgrade = asyncio.run(upgrading.look())
            assert not seen.files, "what had arrived was taken away"
            assert upgrade.send
            assert str(run(upgrading).software.version) == "7.21.5", "the same command again succeeds"
        assert struck
        assert state(running) == before


class Killed(BaseException):
    """The end of our process, at a moment of the test's choice."""


@pytest.mark.parametrize("moment", [PackageSent, Rebooting, PackageConfirmation])
def test_killed_run_can_be_repeated(tmp_path: Path, moment: type) -> None:
    def die(record: Record) -> None:
        if isinstance(record, moment):
            raise Killed

    with router(tmp_path) as (running, upgrading):
        before = state(running)
        with pytest.raises(Killed):
            run(upgrading, Records(die))
        _, upgrade = asyncio.run(upgrading.look())
        if moment is PackageConfirmation:
            assert upgrade.send == (), "it was done, and only not written down"
        else:
            running.do("router", "reset")
            assert str(run(upgrading).software.version) == "7.21.5"
            received = running.do("router", "counters")["wire_in"]
            assert received < upgrade.size, "the file that lay there whole was not sent again"
        assert state(running) == before


def test_outcome_is_unknown_if_device_does_not_come_back(tmp_path: Path) -> None:
    with router(tmp_path, boot_s=3.0) as (running, upgrading):
        hurried = replace(upgrading, waiting=WaitingUpgrade(until_s=1.0, poll_s=0.2, connect_s=0.5))
        with pytest.raises(OutcomeUnknown, match="did not come back within 1 s after the reboot command") as unknown:
            run(hurried)
        assert "run the same command again" in (unknown.value.hint or "")
        running.do("router", "knobs", boot_s=0.0)

        async def until_back() -> Any:  # noqa: ANN401
            return await upgrading._back(asyncio.get_running_loop().time())

        assert str(asyncio.run(until_back()).software.version) == "7.21.5"


def test_device_that_reboots_before_its_session_ends_counts_as_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A link that closes one way keeps the old session for a while, in which the device is up again already."""
    reboot = upgrade_module._reboot

    async def slow(endpoint: Endpoint) -> None:
        await reboot(endpoint)
        await asyncio.sleep(4.0)

    monkeypatch.setattr(upgrade_module, "_reboot", slow)
    monkeypatch.setattr(upgrade_module, "REBOOTED_WITHIN_S", 1.0)
    with router(tmp_path, boot_s=0.1) as (_running, upgrading):
        assert str(run(upgrading).software.version) == "7.21.5"


def test_rejected_package_is_reported_in_the_device_s_words(tmp_path: Path) -> None:
    with router(tmp_path) as (_running, upgrading):
        (right,) = upgrading.packages

        async def forced() -> None:
            seen, upgrade = await upgrading.look()
            wrong = read_npk(write(tmp_path, "gps", "7.16", "arm64"))
            await upgrading.carry_out(seen, replace(upgrade, send=(wrong,)), NoJournal())

        with pytest.raises(DeviceError, match=r"runs RouterOS 7\.18\.2.*can not install gps-7\.16"):
            asyncio.run(forced())
        assert right.name == "routeros"


def test_foreign_packages_on_device_stop_the_run(tmp_path: Path) -> None:
    with router(tmp_path) as (_running, upgrading):
        stranger = read_npk(write(tmp_path, "container", "7.18.2", "arm64"))
        upgrading._upload(stranger, 0, stranger.size)
        with pytest.raises(DeviceError, match=r"container-7\.18\.2-arm64\.npk") as refused:
            asyncio.run(upgrading.look())
        assert "next reboot would install" in str(refused.value)
        assert json.dumps(refused.value.hint)
