"""What a reboot of the twin makes of the package files on its flash."""

from dataclasses import dataclass

import pytest
from npk_files import contents

from atlantis_netcfg.emulator.routeros import Device, RouterSpec
from atlantis_netcfg.emulator.routeros.core import FlashFile


def router(version: str = "7.18.2", packages: tuple[str, ...] = ("routeros",)) -> Device:
    return Device(RouterSpec(name="router", version=version, packages=packages), lambda: 1000.0)


def rebooted(device: Device, *files: tuple[str, str, str]) -> Device:
    """Put packages on the flash beside the router, and boot it."""
    flash = device.snapshot()
    for number, (name, version, architecture) in enumerate(files, start=900):
        text = contents(name, version, architecture).decode(errors="surrogateescape")
        file = FlashFile(number, text, "2026-01-01 08:00:00")
        flash["files"][f"{name}-{version}-{architecture}.npk"] = [file.number, file.contents, file.modified_at]
    device.restore(flash)
    return device


def rows(device: Device, menu: str) -> list[dict[str, str]]:
    caller = device.login("provision", "", via="api-ssl", address="10.64.101.10")
    answers = device.run(caller, [f"{menu}/print"])
    return [dict(word[1:].partition("=")[::2] for word in one.words) for one in answers if one.kind == "!re"]


@dataclass(frozen=True)
class Case:
    packages: tuple[str, ...]
    files: tuple[tuple[str, str, str], ...]
    after: dict[str, str]
    log: tuple[str, ...]


BUNDLE = ("routeros", "7.21.5", "arm64")
CASES = {
    "nothing on the flash": Case(("routeros",), (), {"routeros": "7.18.2"}, ()),
    "an upgrade": Case(("routeros",), (BUNDLE,), {"routeros": "7.21.5"}, ("installed routeros-7.21.5",)),
    "an upgrade with its packages": Case(
        ("routeros", "gps"),
        (BUNDLE, ("gps", "7.21.5", "arm64")),
        {"routeros": "7.21.5", "gps": "7.21.5"},
        ("installed routeros-7.21.5", "installed gps-7.21.5"),
    ),
    "a package forgotten is gone": Case(
        ("routeros", "gps"),
        (BUNDLE,),
        {"routeros": "7.21.5"},
        ("removed gps-7.18.2: it needs system-7.18.2", "installed routeros-7.21.5"),
    ),
    "another architecture": Case(
        ("routeros",),
        (("routeros", "7.21.5", "arm"),),
        {"routeros": "7.18.2"},
        ("can not install routeros-7.21.5: it is made for arm, not arm64",),
    ),
    "a package without its system": Case(
        ("routeros",),
        (("gps", "7.21.5", "arm64"),),
        {"routeros": "7.18.2"},
        ("can not install gps-7.21.5: system-7.21.5 is needed",),
    ),
    "one more of the same version": Case(
        ("routeros",), (("gps", "7.18.2", "arm64"),), {"routeros": "7.18.2", "gps": "7.18.2"}, ("installed gps-7.18.2",)
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_case(name: str) -> None:
    case = CASES[name]
    device = rebooted(router(packages=case.packages), *case.files)
    assert {row["name"]: row["version"] for row in rows(device, "/system/package")} == case.after
    assert tuple(
        row["message"] for row in rows(device, "/log") if "inst" in row["message"] or "remov" in row["message"]
    ) == (case.log)
    assert not [row for row in rows(device, "/file") if row["name"].endswith(".npk")]
    again = rebooted(device)
    assert {row["name"]: row["version"] for row in rows(again, "/system/package")} == case.after


def test_upgrade_brings_new_commands_and_keeps_configuration() -> None:
    device = router("7.16")
    caller = device.login("provision", "", via="api-ssl", address="10.64.101.10")
    device.run(caller, ["/ip/pool/add", "=name=kept", "=ranges=10.0.0.1-10.0.0.9"])
    assert "no such command" in device.run(caller, ["/safe-mode/print"])[0].words[-1]
    before = device.export(header=False)
    rebooted(device, BUNDLE)
    caller = device.login("provision", "", via="api-ssl", address="10.64.101.10")
    assert device.run(caller, ["/safe-mode/print"])[0].kind == "!re"
    assert rows(device, "/system/resource")[0]["version"].startswith("7.21.5")
    assert device.export(header=False) == before


def test_package_file_reports_its_name_and_architecture() -> None:
    device = router()
    flash = device.snapshot()
    whole = contents("routeros", "7.21.5", "arm64").decode(errors="surrogateescape")
    flash["files"]["whole.npk"] = [1, whole, "2026-01-01 08:00:00"]
    flash["files"]["cut.npk"] = [2, whole[:-1], "2026-01-01 08:00:00"]
    flash["files"] |= {"deep/whole.npk": [3, whole, "2026-01-01 08:00:00"]}
    device.restore(flash)
    left = {row["name"]: row for row in rows(device, "/file")}
    assert left.keys() == {"cut.npk", "deep/whole.npk"}, "only whole packages in the root folder are taken"
    assert left["deep/whole.npk"]["package-name"] == "system"
    assert left["deep/whole.npk"]["package-architecture"] == "arm64"
    assert left["cut.npk"]["type"] == "package"
    assert "package-name" not in left["cut.npk"]
