"""Cases as data: what is installed, what is given, and the words of the answer."""

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from row_subtests import for_each_row

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros.packages import InstalledSystem, Npk, RouterOsPackage, Upgrade, UpgradeError, plan

MIB = 1024 * 1024


def version(text: str) -> Version:
    return Version.parse(text)


def npk(name: str, release: str = "7.21.5", architecture: str = "arm64", size: int = MIB) -> Npk:
    return Npk(Path(f"{name}-{release}-{architecture}.npk"), name, version(release), architecture, size, "0" * 64)


def device(*packages: str, release: str = "7.18.2", **more: object) -> InstalledSystem:
    rows = tuple(RouterOsPackage(name, version(release)) for name in packages or ("routeros",))
    found = InstalledSystem(version(release), "arm64", "RB5009UPr+S+", rows, 64 * MIB)
    return replace(found, **more)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Case:
    installed: InstalledSystem
    given: tuple[Npk, ...]
    says: tuple[str, ...] = ()
    """Parts of the refusal; none: it is accepted."""
    send: tuple[str, ...] = ()
    drop: tuple[str, ...] = ()


CASES = {
    "the bundle alone": Case(device(), (npk("routeros"),), send=("routeros",)),
    "the bundle is sent last": Case(
        device("routeros", "container"), (npk("routeros"), npk("container")), send=("container", "routeros")
    ),
    "already there": Case(device(release="7.21.5"), (npk("routeros"),)),
    "a package more of the same version": Case(device(release="7.21.5"), (npk("routeros"), npk("gps")), send=("gps",)),
    "a package of another version alone": Case(
        device(), (npk("gps"),), says=("the routeros package of 7.21.5 is missing",)
    ),
    "a package is forgotten": Case(
        device("routeros", "container"), (npk("routeros"),), says=("container is installed", "drop=container")
    ),
    "a package is given up": Case(
        device("routeros", "container"), (npk("routeros"),), send=("routeros",), drop=("container",)
    ),
    "mixed versions": Case(device(), (npk("routeros"), npk("gps", "7.21.4")), says=("of different versions",)),
    "another architecture": Case(
        device(), (npk("routeros", architecture="arm"),), says=("is for arm, the device is arm64",)
    ),
    "a virtual router": Case(device(architecture="x86_64"), (npk("routeros", architecture="x86"),), send=("routeros",)),
    "back": Case(
        device(),
        (npk("routeros", "7.16"),),
        says=("the device has 7.18.2", "; this command does not downgrade to 7.16"),
    ),
    "older than the board": Case(
        device(release="7.9.2", factory=version("7.20")), (npk("routeros", "7.18.2"),), says=("needs 7.20 or later",)
    ),
    "twice": Case(device(), (npk("routeros"), npk("routeros")), says=("routeros is given twice",)),
    "nothing": Case(device(), (), says=("no package given",)),
    "no room": Case(device(free_bytes=MIB), (npk("routeros"),), says=("1024 KiB free, but 1536 KiB are needed",)),
    "the radio across 7.13": Case(
        device(release="7.4.1", radios=("wlan1",)), (npk("routeros"),), says=("wlan1", "wireless-7.21.5-arm64.npk")
    ),
    "the radio across 7.13 with its driver": Case(
        device(release="7.4.1", radios=("wlan1",)), (npk("routeros"), npk("wireless")), send=("wireless", "routeros")
    ),
    "the radio given up": Case(
        device(release="7.4.1", radios=("wlan1",)), (npk("routeros"),), send=("routeros",), drop=("wireless",)
    ),
    "the radio above 7.13": Case(
        device("routeros", "wireless", release="7.16", radios=("wlan1",)), (npk("routeros"),), says=("wireless is",)
    ),
    "wifiwave2 has a new name": Case(
        device("routeros", "wifiwave2", release="7.12.2", radios=("wifi1",)),
        (npk("routeros"),),
        says=("wifi-qcom or wifi-qcom-ac",),
    ),
    "two drivers": Case(
        device(), (npk("routeros"), npk("wireless"), npk("wifi-qcom")), says=("cannot be active together",)
    ),
    "from 6 with the bundle": Case(
        device("routeros-arm64", "system", "ppp", "wireless", release="6.49.19", radios=("wlan1",)),
        (npk("routeros"), npk("wireless")),
        send=("wireless", "routeros"),
    ),
    "from 6 made of single packages": Case(
        device("system", "ppp", release="6.49.19"),
        (npk("routeros"),),
        says=("on this device consists of single packages",),
    ),
}


@for_each_row("name", CASES)
def test_packages_to_send_or_refusal_match_the_case(name: str) -> None:
    case = CASES[name]
    if case.says:
        with pytest.raises(UpgradeError) as refused:
            plan(case.installed, case.given, give_up=case.drop)
        told = str(refused.value)
        assert all(words in told for words in case.says), told
        assert told.count(";") == len(case.says) - 1 or len(case.says) > 1, f"something else is told too: {told}"
        return
    decided = plan(case.installed, case.given, give_up=case.drop)
    assert tuple(package.name for package in decided.send) == case.send


def after(installed: InstalledSystem, decided: Upgrade) -> InstalledSystem:
    rows = tuple(RouterOsPackage(name, decided.version) for name in decided.expected_packages)
    return replace(installed, version=decided.version, packages=rows)


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if not case.says])
def test_plan_is_idempotent(name: str) -> None:
    case = CASES[name]
    decided = plan(case.installed, case.given, give_up=case.drop)
    again = plan(after(case.installed, decided), case.given, give_up=case.drop)
    assert again.send == ()
    assert again.notes == ()
    assert again.expected_packages == decided.expected_packages


def test_all_refusal_reasons_are_reported_together() -> None:
    with pytest.raises(UpgradeError) as refused:
        plan(device(), (npk("routeros", "7.16", "arm"), npk("gps", "7.15", "arm64")))
    assert all(
        words in str(refused.value)
        for words in ("different versions", "is for arm", "this command does not downgrade to")
    )
    assert "RB5009UPr+S+" in (refused.value.hint or "")
