"""The radios of a gateway on a real Debian with systemd: keys, units, addresses, firewall.

No radio is here: `wlan0` is the end of a cable (veth), on which wpa_supplicant finds no radio. That it joins an access
point is therefore not shown.
"""

import subprocess
import sys
from pathlib import Path

import pytest
from gateway_role import NAME, Stand
from gateway_stand import FREE_CLOCK, Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from waiting import wait_until

from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.inventory import load

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

CONF = "/etc/atlantis/radios/wlan1.conf"
NETWORK = "/etc/systemd/network/04-atlantis-radio-wlan0-girona500.network"
SECRET = "a key # with \"quotes\" and 'all'"
VEHICLES = "group_vars/all/vehicles.yml"


@pytest.fixture
def stand(
    machine: Start,  # noqa: F811 - a fixture
    technician: Key,  # noqa: F811 - a fixture
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Stand:
    """A gateway for which the key of Sparus is vaulted."""
    made = Stand(machine(NAME, spare="wlan0"), technician, tmp_path, ["gateway_base"])
    made.gateway.put("/etc/systemd/system/chrony.service.d/test.conf", FREE_CLOCK)
    made.gateway.run("systemctl daemon-reload")
    password = tmp_path / "password"
    password.write_text("of the vault\n")
    monkeypatch.setenv("ANSIBLE_VAULT_PASSWORD_FILE", str(password))
    edited(made, "key: EXAMPLE-sparus-wifi", f"key: {vaulted()}")
    return made


def vaulted() -> str:
    program = str(Path(sys.executable).with_name("ansible-vault"))
    words = [program, "encrypt_string", "--stdin-name", "key"]
    done = subprocess.run(words, check=True, capture_output=True, text=True, input=SECRET)
    return done.stdout.removeprefix("key: ").replace("\n          ", "\n            ").rstrip()


def edited(stand: Stand, old: str, new: str) -> None:
    path = stand.inventory / VEHICLES
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def said(stand: Stand, command: str) -> str:
    return stand.gateway.run(command).stdout.strip()


def test_the_radios_of_a_gateway(stand: Stand) -> None:
    planned = stand.run("--check", "--diff")
    done = stand.run("--diff")
    assert done["hint"] is None, done["message"]
    assert planned["changes"] == done["changes"]
    assert f"file {CONF}" in done["changes"]
    assert f'psk="{SECRET}"' in said(stand, f"cat {CONF}")
    assert said(stand, f"stat -c '%a %U' /etc/atlantis/radios {CONF}") == "700 root\n600 root"
    shown = (stand.folder / "said").read_text() + str(done) + str(planned)
    assert SECRET not in shown
    assert "EXAMPLE-girona500-wifi" not in shown
    assert "EXAMPLE-girona500-wifi" not in said(stand, "journalctl --no-pager")
    assert any("not rehearsed: wlan1 joins the access point of sparus" in note for note in done["notes"])
    assert 'iifname { "wlan0", "wlan1", "wlan2" } counter' in said(stand, "nft list chain inet atlantis forward")
    assert said(stand, "systemctl is-enabled atlantis-radio@wlan0 atlantis-radio@wlan2") == "enabled\nenabled"
    assert said(stand, "pgrep -a wpa_supplicant || systemctl show -p Result atlantis-radio@wlan0") != ""

    again = stand.run("--diff")
    assert (again["changes"], again["status"]) == ([], "unchanged")

    # A key by hand is drift, and what is declared no more is taken away.
    stand.gateway.run(f"sed -i 's/psk=.*/psk=\"somebody else\"/' {CONF}")
    edited(stand, "        key: EXAMPLE-mares-wifi\n", "")
    edited(stand, "        client: {network: 10.70.3.0/24, address: 10.70.3.2}\n", "")
    mended = stand.run("--diff")
    assert "10.70.1.2/24" in said(stand, "ip -4 -o addr show dev wlan0")
    assert f"file {CONF}" in mended["changes"]
    assert f'psk="{SECRET}"' in said(stand, f"cat {CONF}")
    assert said(stand, "ls /etc/atlantis/radios") == "wlan0.conf\nwlan1.conf"
    assert "wlan2" not in said(stand, "ls /etc/systemd/system/*.wants")
    assert "wlan2" not in said(stand, "nft list chain inet atlantis forward")
    assert stand.run()["changes"] == []


def test_networkd_gives_the_address_and_nothing_else(stand: Stand) -> None:
    declaration = load(stand.inventory, decrypt=lambda _: SECRET)  # its file is laid down here by hand: one of all
    base = gateway_base(declaration, declaration.hosts[NAME])
    text = next(file.content for file in base.configuration.files if file.path == NETWORK)
    before = said(stand, "ip -4 route; ip -4 -o addr show dev eth0; cat /etc/resolv.conf")
    stand.gateway.put(NETWORK, text)
    stand.gateway.run("systemctl start systemd-networkd")
    wait_until(
        lambda: "10.70.1.2/24" in said(stand, "ip -4 -o addr show dev wlan0"),
        lambda: said(stand, "networkctl status wlan0 --no-pager; ip addr"),
    )
    after = said(stand, "ip -4 route; ip -4 -o addr show dev eth0; cat /etc/resolv.conf")
    lines = [line for line in after.splitlines() if line not in before.splitlines()]
    assert [line.split(" proto")[0] for line in lines] == ["10.70.1.0/24 dev wlan0"]
    assert "inet6" not in said(stand, "ip -6 -o addr show dev wlan0")
    warnings = said(stand, "journalctl -b -u systemd-networkd --no-pager | grep -i -e unknown -e ignor -e invalid || :")
    assert warnings == ""
