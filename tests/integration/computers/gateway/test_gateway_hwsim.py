"""Rendered files of hostapd and wpa_supplicant at work: radios of mac80211_hwsim in a computer emulated by qemu.

The radios are the kernel's own simulation (Debian's linux-image-amd64): protocol, keys and isolation are real, the air
is not. Each of them stands in a network namespace of its own. Building and booting takes minutes: `make campaign`.
"""

import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from debian_trees import RADIOS
from gateway_role import NAME
from gateway_stand import (
    Key,
    technician,  # noqa: F401 - a fixture
)
from ports import held_port
from test_gateway_clock import Guest, booted, card

from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.emulator.lab import why_not
from atlantis_netcfg.inventory import load

pytestmark = [pytest.mark.campaign, pytest.mark.timeout(3600)]

SHIPPED = Path(__file__).parents[4] / "inventory"
KEY = "EXAMPLE-of-this-test"
ACCESS_POINT = """\
  access_point:
    interface: wlan0
    ssid: EXAMPLE-GATEWAY
    standard: 802.11g
    band: 2ghz
    frequency_mhz: 2437
    country: portugal
    key: EXAMPLE-key
    network: 10.71.1.0/24
    address: 10.71.1.1
    isolated: {isolated}
"""
ROBOT = f"""\
interface=wlan0
driver=nl80211
ssid=EXAMPLE-SPARUS
hw_mode=g
channel=6
wpa=2
wpa_key_mgmt=WPA-PSK
rsn_pairwise=CCMP
wpa_passphrase={KEY}
"""
STATION = 'network={{\n ssid="EXAMPLE-GATEWAY"\n psk="{key}"\n}}\n'


@pytest.fixture(scope="module")
def guest(technician: Key, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guest]:  # noqa: F811 - a fixture
    """A computer with three radios, called wlan0 in the namespaces r0, r1 and r2."""
    if (reason := why_not()) is not None:
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("guest")
    disk, host_key = card(folder, technician, RADIOS)
    with held_port() as port, booted(folder, disk, host_key, technician, port) as made:
        made.run("systemctl mask --now hostapd wpa_supplicant; modprobe mac80211_hwsim radios=3; udevadm settle")
        for number in range(3):
            made.run(
                f"ip netns add r{number}; phy=$(iw phy | sed -n 's/^Wiphy //p' | head -1); "
                f"iw phy $phy set netns name r{number} && ip netns exec r{number} sh -c '"
                "ip link set lo up; name=$(ls /sys/class/net | grep -v lo); ip link set $name down; "
                "[ $name = wlan0 ] || ip link set $name name wlan0'"
            )
        yield made


def rendered(tmp_path: Path, name: str, *, isolated: bool = True) -> str:
    """A file of the shipped gateway, with the key of this test in the place of every one."""
    made = tmp_path / f"inventory-{isolated}"
    shutil.copytree(SHIPPED, made)
    path = made / "host_vars" / f"{NAME}.yml"
    path.write_text(path.read_text() + ACCESS_POINT.format(isolated=str(isolated).lower()))
    vehicles = made / "group_vars/all/vehicles.yml"
    vehicles.write_text(vehicles.read_text().replace("interface: wlan0", "interface: wlan4"))
    declaration = load(made)
    base = gateway_base(declaration, declaration.hosts[NAME])
    text = next(file.content for file in base.configuration.files if file.path == f"/etc/atlantis/radios/{name}.conf")
    for word in (*base.secrets, base.own_secret or ""):
        text = text.replace(word, KEY) if word else text
    return text


def put(guest: Guest, path: str, text: str) -> None:
    guest.run(f"cat > {path} <<'END'\n{text}END")


def start(guest: Guest, number: int, text: str, *, opens: bool) -> None:
    """Let a radio open a network, or join one, as its file says; what it did before ends."""
    path = f"/root/r{number}.conf"
    put(guest, path, text)
    program = "hostapd -B" if opens else "wpa_supplicant -B -D nl80211 -i wlan0 -c"
    guest.run(f"ip netns pids r{number} | xargs -r kill; sleep 1; ip netns exec r{number} {program} {path}")


def joined(guest: Guest, number: int, timeout_s: float = 60) -> bool:
    end = time.monotonic() + timeout_s
    while time.monotonic() < end:
        if "Connected to" in guest.run(f"ip netns exec r{number} iw dev wlan0 link").stdout and (
            "authorized:\tyes" in guest.run(f"ip netns exec r{number} iw dev wlan0 station dump").stdout
        ):
            return True
        time.sleep(1)
    return False


def answers(guest: Guest, number: int, address: str) -> bool:
    return guest.run(f"ip netns exec r{number} ping -c 5 -W 2 {address}", check=False).returncode == 0


def test_gateway_joins_a_robot_only_with_the_right_key(guest: Guest, tmp_path: Path) -> None:
    text = rendered(tmp_path, "wlan1")
    start(guest, 0, ROBOT, opens=True)
    start(guest, 1, text, opens=False)
    assert joined(guest, 1)
    start(guest, 1, text.replace(KEY, "EXAMPLE-wrong-key"), opens=False)
    assert not joined(guest, 1, 40)


@pytest.mark.parametrize("isolated", [True, False])
def test_station_isolation_matches_the_inventory(guest: Guest, tmp_path: Path, *, isolated: bool) -> None:
    start(guest, 0, rendered(tmp_path, "wlan0", isolated=isolated), opens=True)
    guest.run("ip -n r0 addr replace 10.71.1.1/24 dev wlan0")
    for number in (1, 2):
        start(guest, number, STATION.format(key=KEY), opens=False)
        assert joined(guest, number)
        guest.run(f"ip -n r{number} addr flush dev wlan0; ip -n r{number} addr add 10.71.1.1{number}/24 dev wlan0")
        assert answers(guest, number, "10.71.1.1")
    assert answers(guest, 1, "10.71.1.12") is not isolated


def test_station_with_another_key_is_rejected(guest: Guest, tmp_path: Path) -> None:
    start(guest, 0, rendered(tmp_path, "wlan0"), opens=True)
    start(guest, 1, STATION.format(key="EXAMPLE-another-key"), opens=False)
    assert not joined(guest, 1, 40)
