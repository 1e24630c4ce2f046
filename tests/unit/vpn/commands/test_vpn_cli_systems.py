"""What a device runs decides the key that it gets: by the declaration, else by the words of the command."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pyrage
import pytest
from vpn_desk import NOBODY, PASSPHRASE, Desk, declared, onboarding, seated

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.vpn import _common
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import OpenVpnVersion, RosDistribution
from atlantis_netcfg.vpn import systems
from atlantis_netcfg.vpn.enrolment_package import open_package
from atlantis_netcfg.vpn.identity import SYSTEMS, ClientSystem, MemberKind, Wrap


@pytest.fixture
def desk(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Desk:
    return seated(tmp_path_factory.getbasetemp(), tmp_path, capsys, monkeypatch)


def pilot(
    vehicle: dict[str, Any], robot_openvpn: OpenVpnVersion | None = None, distribution: RosDistribution | None = None
) -> Inventory:
    """The shipped pilot with other keys of the vehicle `sparus`, and other ones of the pilot."""
    shipped = declared()
    sparus = shipped.vehicles["sparus"].model_copy(update=vehicle)
    assert shipped.pilot.dds is not None
    dds = shipped.pilot.dds.model_copy(update={"distribution": distribution}) if distribution else None
    vpn = shipped.pilot.vpn.model_copy(update={"robot_openvpn": robot_openvpn})
    changed = shipped.pilot.model_copy(update={"vpn": vpn, "dds": dds})
    return replace(shipped, pilot=changed, vehicles={**shipped.vehicles, "sparus": sparus})


FOXY, HUMBLE, JAZZY = RosDistribution
OLD, NEW = OpenVpnVersion.V2_4, OpenVpnVersion.V2_6
CASES = {
    "the pilot's foxy": (pilot({}, distribution=FOXY), OLD),
    "the pilot's jazzy": (pilot({}, distribution=JAZZY), NEW),
    "the pilot's OpenVPN counts more than its release": (pilot({}, NEW, FOXY), NEW),
    "the vehicle's release counts more than the pilot's OpenVPN": (pilot({"distribution": FOXY}, NEW, JAZZY), OLD),
    "the vehicle's OpenVPN counts more than its release": (pilot({"distribution": FOXY, "openvpn": NEW}), NEW),
    "nothing is known": (pilot({}), None),
}


@pytest.mark.parametrize("case", CASES)
def test_openvpn_version_follows_from_the_vehicle(case: str) -> None:
    declaration, version = CASES[case]
    assert systems.openvpn(declaration, MemberKind.ROBOT, "sparus") == version
    assert systems.wrap_for(version) is (Wrap.TLS_CRYPT if version is OLD else Wrap.TLS_CRYPT_V2)
    assert systems.wrap_for(version, force_cookie=True) is (Wrap.TLS_CRYPT_V2 if version is NEW else Wrap.TLS_CRYPT)


def test_every_distribution_has_an_ubuntu_and_every_kind_its_systems() -> None:
    assert set(systems.UBUNTU) == set(RosDistribution)
    assert set(SYSTEMS) == set(MemberKind)
    assert {system for some in SYSTEMS.values() for system in some} == set(ClientSystem)


def wrap(desk: Desk, *words: str) -> str:
    (row,) = desk.told(*words, f"recipient={NOBODY}", passphrase=PASSPHRASE)["members"]
    member = desk.told("show", f"name={row['name']}")["member"]
    newest: str = member["certificates"][-1]["wrap"]
    return newest


def test_key_wrapping_follows_from_inventory_and_arguments(desk: Desk) -> None:
    assert wrap(desk, *onboarding("iqua", "sparus2", "robot")) == "tls-crypt"  # the shipped pilot has foxy
    assert wrap(desk, *onboarding("iqua", "auv1", "robot", "distribution=humble")) == "tls-crypt-v2"
    assert wrap(desk, *onboarding("iqua", "auv2", "robot", "openvpn=2.6")) == "tls-crypt-v2"
    assert wrap(desk, *onboarding("iqua", "laptop1")) == "tls-crypt-v2"
    assert wrap(desk, *onboarding("iqua", "laptop2", "laptop", "system=linux", "openvpn=2.4")) == "tls-crypt"
    assert wrap(desk, *onboarding("iqua", "router1", "router")) == "tls-crypt-v2"


def test_server_requiring_a_cookie_gives_older_clients_the_shared_key(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert wrap(desk, *onboarding("iqua", "router1", "router")) == "tls-crypt-v2"
    shipped = declared()
    vpn = shipped.pilot.vpn.model_copy(update={"force_cookie": True})
    changed = replace(shipped, pilot=shipped.pilot.model_copy(update={"vpn": vpn}))
    monkeypatch.setattr(_common, "load_inventory", lambda _arguments: changed)
    assert wrap(desk, *onboarding("iqua", "laptop1")) == "tls-crypt"
    assert wrap(desk, *onboarding("iqua", "laptop2", "laptop", "openvpn=2.5")) == "tls-crypt"
    assert wrap(desk, *onboarding("iqua", "laptop3", "laptop", "openvpn=2.6")) == "tls-crypt-v2"
    assert wrap(desk, "onboard", "device=coastal-router", "--no-push") == "tls-crypt"
    assert wrap(desk, "renew", "name=iqua-router1", "--no-push") == "tls-crypt"
    asked = (*onboarding("iqua", "laptop4", "laptop", "openvpn=2.5"), "wrap=tls-crypt-v2")
    (error,) = desk.told(*asked, passphrase=PASSPHRASE, code=3)["errors"]
    assert "the server accepts such clients only from OpenVPN 2.6 on (`force_cookie`)" in error["message"]


def test_argument_contradicting_the_vehicle_is_refused(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    changed = pilot({"distribution": HUMBLE, "openvpn": NEW}, distribution=FOXY)
    monkeypatch.setattr(_common, "load_inventory", lambda _arguments: changed)
    words = onboarding("iqua", "sparus2", "robot", "distribution=foxy", "openvpn=2.4")
    told = desk.told(*words, passphrase=PASSPHRASE, code=3)
    said = [(error["message"], error["hint"]) for error in told["errors"]]
    assert "`distribution=foxy`: the inventory has `sparus` with `distribution: humble`" in str(said)
    assert "`openvpn=2.4`: the inventory has `sparus` with `openvpn: 2.6`" in str(said)
    assert wrap(desk, *onboarding("iqua", "sparus2", "robot", "distribution=humble")) == "tls-crypt-v2"


def test_renewal_uses_a_key_format_the_client_can_read(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    renew = ("renew", "name=iqua-sparus2", "--no-push")
    assert wrap(desk, *onboarding("iqua", "sparus2", "robot", "openvpn=2.6")) == "tls-crypt-v2"
    told = desk.told(*renew, "wrap=tls-crypt-v2", passphrase=PASSPHRASE, code=3)
    assert "`: the device has OpenVPN 2.4, which cannot read such a profile" in told["errors"][0]["message"]
    assert wrap(desk, *renew) == "tls-crypt"
    monkeypatch.setattr(_common, "load_inventory", lambda _arguments: pilot({"openvpn": NEW}, distribution=FOXY))
    assert wrap(desk, *renew) == "tls-crypt"  # as before, since it can be read
    assert wrap(desk, *renew, "wrap=tls-crypt-v2") == "tls-crypt-v2"


def test_client_system_is_stored_and_reused_on_renewal(desk: Desk) -> None:
    key = pyrage.x25519.Identity.generate()
    words = (*onboarding("iqua", "laptop", "laptop", "system=windows"), f"recipient={key.to_public()}")
    (row,) = desk.told(*words, passphrase=PASSPHRASE)["members"]
    first = opened(row, key)
    assert ("self-test.ps1" in first, "self-test.py" in first, "OpenVPN GUI" in first["README.txt"]) == (
        True,
        False,
        True,
    )
    assert desk.told(*words)["members"][0]["already"]
    other = (*onboarding("iqua", "laptop", "laptop", "system=macos"), f"recipient={NOBODY}")
    refused = desk.told(*other, passphrase=PASSPHRASE, code=3)["errors"][0]["message"]
    assert "system is windows, not macos" in refused
    renew = ("renew", "name=iqua-laptop", "--no-push", f"recipient={key.to_public()}")
    (again,) = desk.told(*renew, passphrase=PASSPHRASE)["members"]
    assert "self-test.ps1" in opened(again, key)
    (moved,) = desk.told(*renew, "system=macos", passphrase=PASSPHRASE)["members"]
    assert "Tunnelblick" in opened(moved, key)["README.txt"]
    refused = desk.told(*renew, "system=routeros", passphrase=PASSPHRASE, code=3)["errors"][0]["message"]
    assert refused == "`system=routeros`: a laptop does not use this system"


def opened(row: dict[str, Any], key: pyrage.x25519.Identity) -> dict[str, str]:
    return open_package(Path(row["file"]).read_bytes(), Secret(str(key)))


def test_cover_note_is_stored_beside_the_package_and_copied_to_the_stick(desk: Desk, tmp_path: Path) -> None:
    stick = tmp_path / "stick"
    stick.mkdir()
    words = (*onboarding("iqua", "sparus2", "robot"), f"to={stick}", "contact=Ana Example, +351 000")
    (row,) = desk.told(*words, passphrase=PASSPHRASE)["members"]
    assert {path.name for path in stick.iterdir()} == {"iqua-sparus2.tar.age", "iqua-sparus2.cover-note.txt"}
    note = (stick / "iqua-sparus2.cover-note.txt").read_text()
    assert row["cover_note"] == str(stick / "iqua-sparus2.cover-note.txt")
    assert (desk.authority / "handouts/iqua-sparus2/iqua-sparus2.cover-note.txt").read_text() == note
    assert row["sha256"] in note
    assert "Ana Example, +351 000" in note
    assert row["passphrase"] not in note
    assert desk.told(*words)["members"][0]["cover_note"] is None


def test_help_lists_the_kinds_and_systems(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vpn", "onboard", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    kinds = [kind for kind in MemberKind if kind is not MemberKind.HOST]
    assert [word for word in (*kinds, *ClientSystem, *RosDistribution, *OpenVpnVersion) if word not in said] == []
