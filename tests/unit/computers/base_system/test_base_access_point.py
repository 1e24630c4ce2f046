"""Part `gateway_base`: the access point that a gateway opens by hostapd, read by the real program."""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest
from waiting import HANG_S

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.desired_state import DesiredState
from atlantis_netcfg.computers.base import GatewayBase, gateway_base
from atlantis_netcfg.inventory import load

ROOT = Path(__file__).parents[4]
GATEWAY = "coastal-gateway"
BULLSEYE = ROOT / ".venv-setup" / "debian" / "bullseye"
FILE = "/etc/atlantis/radios/wlan3.conf"
DECLARED = {
    "interface": "wlan3",
    "ssid": "EXAMPLE-COASTAL-GATEWAY",
    "standard": "802.11ac",
    "band": "5ghz",
    "frequency_mhz": "5500",
    "country": "portugal",
    "key": "EXAMPLE-gateway-key",
    "network": "10.71.1.0/24",
    "address": "10.71.1.1",
}


def part(tmp_path: Path, changes: Mapping[str, str] | None = None, *, rehearsed: bool = False) -> GatewayBase:
    made = tmp_path / "inventory"
    shutil.copytree(ROOT / "inventory", made)
    path = made / "host_vars" / f"{GATEWAY}.yml"
    rows = "".join(f"    {name}: {value}\n" for name, value in {**DECLARED, **(changes or {})}.items())
    path.write_text(f"{path.read_text()}  access_point:\n{rows}")
    declaration = load(made)
    return gateway_base(declaration, declaration.hosts[GATEWAY], is_rehearsal=rehearsed)


def files(base: GatewayBase) -> dict[str, str]:
    return {file.path: file.content for file in base.configuration.files}


def test_network_has_a_key_and_no_way_out(tmp_path: Path) -> None:
    base = part(tmp_path)
    lines = files(base)[FILE].splitlines()
    assert {"country_code=PT", "channel=100", "hw_mode=a", "wpa_key_mgmt=WPA-PSK", "ap_isolate=1"} <= {*lines}
    network = files(base)["/etc/systemd/network/04-atlantis-radio-wlan3.network"].splitlines()
    assert {"Address=10.71.1.1/24", "DHCPServer=yes", "EmitRouter=no", "EmitDNS=no"} <= {*network}
    rules = files(base)["/etc/nftables.conf"]
    assert 'iifname { wlan0, wlan1, wlan2, wlan3 } counter drop comment "from robots"' in rules
    assert 'iifname wlan3 udp sport 68 udp dport 67 accept comment "DHCP for stations"' in rules
    assert {"hostapd", "wpasupplicant"} <= {package.name for package in base.packages}
    units = {unit.name: (unit.enabled, unit.active) for unit in base.configuration.units}
    assert units["atlantis-access-point@wlan3.service"] == (True, None)
    assert units["hostapd.service"] == (False, False)


def test_key_comes_from_the_inventory_and_is_never_shown(tmp_path: Path) -> None:
    told = part(tmp_path).as_dict()
    assert "EXAMPLE-gateway-key" not in json.dumps(told)
    secrets = dict.fromkeys(told["secrets"], "EXAMPLE-of-a-robot") | {told["own_secret"]: "EXAMPLE-gateway-key"}
    laid = {file.path: file for file in DesiredState.of({**told["configure"], "secrets": secrets}).files}
    assert "wpa_passphrase=EXAMPLE-gateway-key\n" in laid[FILE].content
    assert (laid[FILE].secret, laid[FILE].mode) == (True, "0600")


def test_station_isolation_can_be_disabled(tmp_path: Path) -> None:
    assert "ap_isolate=0" in files(part(tmp_path, {"isolated": "false"}))[FILE]


def test_rehearsal_notes_that_no_network_is_opened(tmp_path: Path) -> None:
    notes = [item.note for item in part(tmp_path, rehearsed=True).configuration.brought]
    assert notes[-1] == "not rehearsed: wlan3 opens the network EXAMPLE-COASTAL-GATEWAY; this machine has no radio"


HOSTAPDS = {
    "2.9": (BULLSEYE / "hostapd" / "usr" / "sbin" / "hostapd", BULLSEYE / "libssl1.1"),
    "2.10": (Path("/usr/sbin/hostapd"), None),
}


@pytest.fixture(params=list(HOSTAPDS))
def hostapd(request: pytest.FixtureRequest) -> tuple[Path, Path | None]:
    """The program of Debian 11 and of Debian 12, with the libraries that it needs."""
    program, packed = HOSTAPDS[request.param]
    if not program.exists():
        pytest.skip(f"there is no hostapd {request.param} here")
    libraries = None if packed is None else next(packed.glob("usr/lib/*/libssl.so.1.1")).parent
    environment = {} if libraries is None else {"LD_LIBRARY_PATH": str(libraries)}
    said = subprocess.run([program, "-v"], check=False, capture_output=True, text=True, env=environment)
    assert f"hostapd v{request.param}\n" in said.stdout + said.stderr
    return program, libraries


def read_by(program: Path, libraries: Path | None, file: Path) -> str:
    """What hostapd says of a file, for a radio that nobody has; it ends by itself."""
    environment = {**os.environ} if libraries is None else {**os.environ, "LD_LIBRARY_PATH": str(libraries)}
    words = [str(program), "-i", "atlantis-none", str(file)]
    done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=HANG_S, env=environment)
    assert done.returncode != 0
    return done.stdout + done.stderr


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"wpa": "wpa3"},
        {"band": "2ghz", "standard": "802.11g", "frequency_mhz": "2437"},
        {"band": "2ghz", "standard": "802.11n", "frequency_mhz": "2472"},
        {"standard": "802.11a", "frequency_mhz": "5700"},
        {"ssid": "'Olá \"é\" #1'"},
        {"ssid": "'a \"b\" #1'"},
        {"isolated": "false", "country": "portugal"},
    ],
    ids=["ac", "wpa3", "g", "n", "a", "accents", "quotes", "together"],
)
def test_hostapd_accepts_the_file(hostapd: tuple[Path, Path | None], tmp_path: Path, changes: dict[str, str]) -> None:
    file = tmp_path / "wlan3.conf"
    file.write_text(files(part(tmp_path, changes))[FILE])
    said = read_by(*hostapd, file)
    assert "errors found in configuration file" not in said
    assert not re.search(r"^Line \d+", said, re.MULTILINE), said
    assert "driver" in said or "Could not" in said, said


@pytest.mark.parametrize(
    "word",
    ["ssid2", "country_code", "ieee80211d", "hw_mode", "channel", "ieee80211n", "wpa", "wpa_key_mgmt", "ap_isolate"],
)
def test_hostapd_refuses_a_misspelt_key(hostapd: tuple[Path, Path | None], tmp_path: Path, word: str) -> None:
    file = tmp_path / "wlan3.conf"
    file.write_text(re.sub(rf"^{word}=", f"{word}x=", files(part(tmp_path))[FILE], flags=re.MULTILINE))
    said = read_by(*hostapd, file)
    assert f"unknown configuration item '{word}x'" in said
    assert "errors found in configuration file" in said


@pytest.mark.parametrize(("word", "accepted"), [("wpa_passphrase", True), ("wpa_pasphrase", False)])
def test_validator_of_the_gateway_detects_bad_files(tmp_path: Path, word: str, *, accepted: bool) -> None:
    base = part(tmp_path)
    radio = next(file for file in base.configuration.files if file.path == FILE)
    file = tmp_path / "wlan3.conf"
    file.write_text(radio.content.replace("wpa_passphrase=", f"{word}="))
    words = [item.replace("%s", str(file)) for item in radio.validate]
    done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=HANG_S)
    assert (done.returncode == 0) is accepted, done.stdout + done.stderr
    assert ("unknown configuration item" in done.stdout) is not accepted


def ruleset(tmp_path: Path, **changes: str) -> str:
    return files(part(tmp_path, changes))["/etc/nftables.conf"]


def test_stations_reach_only_the_vpn_server(tmp_path: Path) -> None:
    text = ruleset(tmp_path, vpn="true")
    forward = text[text.index("chain forward") :]
    assert "hook forward priority 0; policy drop;" in forward
    accepted = [line.split(" accept")[0].strip() for line in forward.splitlines() if " accept comment" in line]
    assert accepted == [
        "iifname wlan3 ip saddr 10.71.1.0/24 ip daddr 203.0.113.2 udp dport 1194",
        "oifname wlan3 ip saddr 203.0.113.2 udp sport 1194 ct state established",
    ]
    assert forward.index("to the VPN") < forward.index("from robots")
    assert "ip saddr 10.71.1.0/24 ip daddr 203.0.113.2 masquerade" in forward


def test_forwarding_is_enabled_only_while_the_network_is_open(tmp_path: Path) -> None:
    laid = files(part(tmp_path, {"vpn": "true"}))
    unit = laid["/etc/systemd/system/atlantis-access-point@.service"]
    assert "ExecStartPre=/bin/sh -c 'echo 1 > /proc/sys/net/ipv4/ip_forward'" in unit
    assert "ExecStopPost=/bin/sh -c 'echo 0 > /proc/sys/net/ipv4/ip_forward'" in unit
    assert "EmitRouter=yes" in laid["/etc/systemd/network/04-atlantis-radio-wlan3.network"]


def test_nothing_is_forwarded_by_default(tmp_path: Path) -> None:
    laid = files(part(tmp_path))
    assert "masquerade" not in laid["/etc/nftables.conf"]
    assert "ip_forward" not in laid["/etc/systemd/system/atlantis-access-point@.service"]
    assert "EmitRouter=no" in laid["/etc/systemd/network/04-atlantis-radio-wlan3.network"]
