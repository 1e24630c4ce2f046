"""A bundle installs a gateway that has no network but the management path, and a broken carry is gone on with."""

from pathlib import Path

import pytest
from gateway_stand import Key, Start, ground, machine, technician
from offline_stand import CUT, Quay, install, told

from atlantis_netcfg.computers.bundle.open import bytes_to_carry, open_bundle
from atlantis_netcfg.emulator.lab.stubs import StubPackage

__all__ = ["ground", "machine", "technician"]
pytestmark = [pytest.mark.slow, pytest.mark.namespace]
PACKAGES = (
    StubPackage("mission-log", "1:1.2-3", ("mission-data (>= 4)",)),
    StubPackage("mission-data", "4.0", padding_kb=900),
)
NEWER = (StubPackage("mission-log", "1:1.3-1", ("mission-data (>= 4)",)), PACKAGES[1])


@pytest.fixture
def quay(machine: Start, technician: Key, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Quay:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1")  # the same package is the same file each time that it is made
    gateway = machine("coastal-gateway")
    gateway.run(CUT)
    return Quay(gateway, technician, tmp_path)


def test_a_gateway_without_network_is_installed_from_a_bundle(quay: Quay) -> None:
    manifest = quay.bundle(PACKAGES)
    planned, said = quay.run(words=["--check"])
    assert planned == 0, said
    assert (told(said)["ready"], told(said)["carried_bytes"] > 900_000) == (False, True)
    assert quay.gateway.run("ls -A /var/lib/atlantis/bundle 2>/dev/null", check=False).stdout == ""

    first, said = quay.run(install(PACKAGES))
    assert first == 0, said
    assert told(said)["changes"][-1] == f"bundle {manifest.id} assembled"
    versions = quay.gateway.run("dpkg-query -W -f '${Package} ${Version}\\n' mission-log mission-data").stdout
    assert versions == "mission-data 4.0\nmission-log 1:1.2-3\n"
    before = quay.gateway.traffic.up_bytes
    second, said = quay.run(install(PACKAGES))
    assert second == 0, said
    assert "changed=0" in said
    assert told(said)["carried_bytes"] == 0
    assert quay.gateway.traffic.up_bytes - before < 400_000  # the modules

    quay.bundle(NEWER, name="newer")
    code, said = quay.run(install(NEWER), name="newer")
    assert code == 0, said
    assert told(said)["carried_bytes"] < 20_000  # mission-data is there already
    assert f"bundle {manifest.id} removed" in told(said)["changes"]


def test_killed_bundle_transfer_resumes_and_sends_only_the_rest(quay: Quay) -> None:
    parts = tuple(StubPackage(f"map-part{number}", "1", padding_kb=3000) for number in range(6))
    manifest = quay.bundle(parts)
    whole = bytes_to_carry(open_bundle(quay.folder / "bundle", quay.keys), "coastal-gateway")
    quay.gateway.link(rate_up_bps=40_000_000)
    quay.cut_off(quay.gateway.traffic.up_bytes + whole // 3)
    quay.gateway.link()
    assert manifest.id not in quay.gateway.run("ls -A /var/lib/atlantis/bundle").stdout.split()

    before = quay.gateway.traffic.up_bytes
    code, said = quay.run(install(parts))
    assert code == 0, said
    sent = quay.gateway.traffic.up_bytes - before
    rest = told(said)["carried_bytes"]
    assert 3_000_000 < rest <= whole - 3_000_000
    assert sent < rest + 1_000_000  # the modules
    assert quay.gateway.run("ls -A /var/lib/atlantis/bundle/.incoming").stdout == ""
    code, said = quay.run(install(parts))
    assert (code, "changed=0" in said, told(said)["carried_bytes"]) == (0, True, 0), said


def test_damaged_file_on_the_board_is_sent_again(quay: Quay) -> None:
    manifest = quay.bundle(PACKAGES)
    code, said = quay.run()
    assert code == 0, said
    pool = f"/var/lib/atlantis/bundle/{manifest.id}/repository/pool"
    quay.gateway.run(f"printf x | dd of=$(ls {pool}/mission-log*) bs=1 seek=100 conv=notrunc")
    code, said = quay.run(install(PACKAGES))
    assert code == 0, said
    assert told(said)["carried_bytes"] == 10_240
    assert "changed=0" in quay.run(install(PACKAGES))[1]


def test_unprivileged_account_transfers_and_metered_link_needs_consent(quay: Quay) -> None:
    quay.gateway.run("useradd -m odroid && cp -r /root/.ssh /home/odroid && chown -R odroid /home/odroid")
    quay.gateway.put("/etc/sudoers.d/odroid", "odroid ALL=(ALL) NOPASSWD: ALL\n", mode="0440")
    quay.bundle(PACKAGES)
    quay.variables |= {"ansible_user": "odroid", "ansible_become": True, "computer_reached": {"metered": "4g"}}
    code, said = quay.run()
    assert code == 2
    assert "of the bundle would go over metered link 4g, and nobody has consented to the cost" in said
    quay.variables["atlantis_accept_cost"] = True
    code, said = quay.run(install(PACKAGES))
    assert code == 0, said
    assert quay.gateway.run("stat -c '%U %a' /var/lib/atlantis/bundle/.incoming").stdout == "odroid 700\n"
    assert "changed=0" in quay.run(install(PACKAGES))[1]
