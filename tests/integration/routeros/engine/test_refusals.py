"""Runs that end before anything was changed: the status, the words, and a router as it was."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from engine_bench import PASSWORD, TEXT, Bench, on

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import DeviceMode, User
from atlantis_netcfg.emulator.routeros import DeviceModeName as TwinMode
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status, converge, desired

MANAGEMENT = 'add address=10.64.101.1/24 comment="atlantis: management" interface=ether8\n'


def refused(bench: Bench, status: Status, *words: str, **changes: Any) -> DeviceResult:  # noqa: ANN401 - fields of DeviceJob
    """Converge, and hold the result to its status, its words and an untouched router."""

    async def act(bench: Bench) -> tuple[DeviceResult, str, str]:
        before = bench.export()
        return await bench.converge(**changes), before, bench.export()

    result, before, now = on(bench, act)
    assert (result.status, result.exit) == (status, ExitCode.FAILED)
    for each in words:
        assert each in result.message
    assert result.confirmed_count == 0
    assert now == before
    assert bench.store.runs("coastal")[0].outcomes["router"].status == status
    return result


def test_a_wrong_password(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> DeviceResult:
        return await bench.converge(endpoint=replace(bench.job().endpoint, password=Secret("wrong")))

    result = on(bench, act)
    assert (result.status, result.exit) == (Status.LEFT_AS_FOUND, ExitCode.FAILED)
    assert "refused the login of `provision`: invalid user name or password (6)" in result.message
    assert result.hint is not None
    assert "vaulted password" in result.hint


def test_another_certificate(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, int]:
        job = bench.job()
        bench.router.recertify()
        result = await bench.converge(endpoint=job.endpoint)
        return result, bench.router.counters().logins

    result, logins = on(bench, act)
    assert result.status is Status.LEFT_AS_FOUND
    assert "the certificate is not the one of this device" in result.message
    assert logins == 0
    assert bench.store.pins.get("router") is None


def test_unpinned_certificate_is_refused_without_a_login(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, int]:
        result = await bench.converge(endpoint=replace(bench.job().endpoint, pin=None))
        return result, bench.router.counters().logins

    result, logins = on(bench, act)
    assert (result.status, logins) == (Status.LEFT_AS_FOUND, 0)
    assert "its certificate is unknown here, so no password was sent" in result.message
    assert bench.store.pins.get("router") is None


def test_unreachable_device_is_reported(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> DeviceResult:
        endpoint = bench.job().endpoint
        await bench.router.console(["/ip/service/disable", "=numbers=api-ssl"])
        assert "api-ssl" not in bench.router.ports
        return await converge(bench.job(endpoint=endpoint))

    result = on(bench, act)
    assert (result.status, result.round_trips) == (Status.LEFT_AS_FOUND, 0)
    assert "cannot be reached" in result.message


def test_another_admin_holds_safe_mode(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult, bool]:
        await bench.router.console(["/safe-mode/take"])
        await bench.router.console(["/ip/pool/add", "=name=theirs", "=ranges=10.9.9.9"])
        result, planned = await bench.converge(), await bench.converge(JobMode.PLAN)
        return result, planned, "theirs" in bench.export()

    result, planned, kept = on(bench, act)
    assert (result.status, result.exit) == (Status.LEFT_AS_FOUND, ExitCode.FAILED)
    assert result.message.startswith("api:provision@10.64.101.10 holds safe mode")
    assert planned.status is Status.PLANNED
    assert kept


HOME = DeviceMode(mode=TwinMode.HOME)


def test_a_device_without_any_protection(tmp_path: Path) -> None:
    result = refused(
        Bench(tmp_path, spec={"version": "7.17.1", "device_mode": HOME}),
        Status.REFUSED,
        "nothing would roll this change back if it failed: no safe mode: RouterOS before 7.18 has safe mode "
        "on a console only",
        "no dead-man job: device-mode home forbids the scheduler",
        "and touches the management path",
    )
    assert result.hint is not None
    assert "--without-protection" in result.hint


def test_unprotected_change_can_be_allowed(tmp_path: Path) -> None:
    bench = Bench(tmp_path, spec={"version": "7.17.1", "device_mode": HOME})

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult]:
        return await bench.converge(allows_unprotected=True), await bench.converge(allows_unprotected=True)

    first, second = on(bench, act)
    assert (first.status, first.protection, second.status) == (Status.CHANGED, "none", Status.UNCHANGED)
    assert any("nothing protects this change" in note for note in first.notes)


def test_harmless_change_needs_no_protection(tmp_path: Path) -> None:
    text = MANAGEMENT.join(
        ("/ip address\n", '/ip pool\nadd comment="atlantis: x" name=spare ranges=10.9.9.1-10.9.9.9\n')
    )
    bench = Bench(tmp_path, text=text, spec={"version": "7.16"})
    result = on(bench, lambda bench: bench.converge())
    assert (result.status, result.protection, result.confirmed_count) == (Status.CHANGED, "none", 1)


def test_device_mode_home_is_no_obstacle(tmp_path: Path) -> None:
    bench = Bench(tmp_path, spec={"device_mode": DeviceMode(mode=TwinMode.HOME)})
    assert on(bench, lambda bench: bench.converge()).status is Status.CHANGED


def test_device_mode_home_forbids_a_feature(tmp_path: Path) -> None:
    bench = Bench(
        tmp_path, text=TEXT + "/ip proxy\nset enabled=yes\n", spec={"device_mode": DeviceMode(mode=TwinMode.HOME)}
    )
    refused(bench, Status.REFUSED, "device-mode home forbids proxy", "/system device-mode update proxy=yes")


@pytest.mark.parametrize("group", ["read", "write"])
def test_insufficient_policies_of_our_user_are_refused(tmp_path: Path, group: str) -> None:
    users = (User(name="provision", password=PASSWORD, group=group),)
    refused(Bench(tmp_path, spec={"users": users}), Status.REFUSED, "our user lacks the permissions", "policy")


def test_a_certificate_that_is_not_on_the_device(tmp_path: Path) -> None:
    text = TEXT + (
        "/interface ovpn-client\nadd certificate=missing-one"
        ' comment="atlantis: vpn" connect-to=192.0.2.10 name=vpn user=router\n'
    )
    words = "needs certificate missing-one, which is not on the device: type `provision vpn install device="
    refused(Bench(tmp_path, text=text), Status.REFUSED, words)


def test_a_menu_that_the_version_lacks(tmp_path: Path) -> None:
    text = TEXT + "/routing settings\nset check-gateway-ping-count=3\n"
    refused(Bench(tmp_path, text=text), Status.REFUSED, "RouterOS 7.21")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (MANAGEMENT, ""),
        ("interface=ether5\n", 'interface=ether5\nadd bridge=bridge-lan comment="atlantis: lan" interface=ether8\n'),
        ("set telnet disabled=yes\n", "set telnet disabled=yes\nset api-ssl disabled=yes\n"),
        ("set telnet disabled=yes\n", "set telnet disabled=yes\nset api-ssl address=192.0.2.0/24\n"),
        ("set telnet disabled=yes\n", "set telnet disabled=yes\nset api-ssl port=9999\n"),
        ('add action=accept chain=input comment="atlantis: management" in-interface=ether8\n', ""),
        (
            "/ip pool\n",
            '/ip route\nadd comment="atlantis: x" dst-address=10.64.101.10/32 gateway=10.64.1.2\n/ip pool\n',
        ),
    ],
    ids=["address", "bridge port", "service", "service address", "service port", "input rule", "route"],
)
def test_plan_that_would_cut_our_access_is_refused(tmp_path: Path, old: str, new: str) -> None:
    assert old in TEXT
    refused(Bench(tmp_path, text=TEXT.replace(old, new, 1)), Status.REFUSED, "refused, nothing was changed")


def test_a_full_disk_before_the_first_change(tmp_path: Path) -> None:
    """The saved state does not fit: safe mode was taken in the same round trip, and is left again."""
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, str, str, str]:
        before = bench.export()
        with bench.journal() as journal:
            (journal.directory / "before").write_text("a file where a directory has to be")
            result = await bench.converge(journal=journal)
        answers = await bench.router.console(["/safe-mode/print"])
        return result, before, bench.export(), str(answers)

    result, before, now, safe_mode = on(bench, act)
    assert (result.status, result.exit) == (Status.LEFT_AS_FOUND, ExitCode.FAILED)
    assert "the state before the run cannot be written" in result.message
    assert now == before
    assert "=enabled=false" in safe_mode


def test_secret_is_neither_printed_nor_stored(tmp_path: Path) -> None:
    text = TEXT + (
        '/interface ovpn-client\nadd comment="atlantis: vpn" connect-to=192.0.2.10 name=vpn password=hush-hush user=r\n'
    )
    bench = Bench(tmp_path, text=text)

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult]:
        return await bench.converge(JobMode.PLAN), await bench.converge()

    planned, result = on(bench, act)
    assert (planned.status, result.status) == (Status.PLANNED, Status.CHANGED)
    told = [str(planned.as_dict()), str(result.as_dict()), str(bench.events)]
    written = [path.read_bytes() for path in tmp_path.rglob("state/**/*") if path.is_file()]
    assert "********" in planned.diff
    assert not any("hush-hush" in each for each in told)
    assert not any(b"hush-hush" in each for each in written)
    assert desired.read(text).menus
