"""Part `gateway_base`: the radios of a gateway, which join the access points of vehicles."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from waiting import HANG_S

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.desired_state import DesiredState
from atlantis_netcfg.computers.base import GatewayBase, gateway_base
from atlantis_netcfg.inventory import load

ROOT = Path(__file__).parents[4]
GATEWAY = "coastal-gateway"
KEYS = {"@wifi-key-of-girona500@": "girona500", "@wifi-key-of-sparus@": "sparus", "@wifi-key-of-mares@": "mares"}
BULLSEYE = ROOT / ".venv-setup" / "debian" / "bullseye"


def part(tmp_path: Path, *edits: tuple[str, str], rehearsed: bool = False) -> GatewayBase:
    made = tmp_path / "inventory"
    shutil.copytree(ROOT / "inventory", made)
    path = made / "group_vars" / "all" / "vehicles.yml"
    text = path.read_text()
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    declaration = load(made)
    return gateway_base(declaration, declaration.hosts[GATEWAY], is_rehearsal=rehearsed)


def files(base: GatewayBase) -> dict[str, str]:
    return {file.path: file.content for file in base.configuration.files}


def lines(text: str) -> list[str]:
    return [line.strip() for line in text.splitlines()]


def read_by(program: Path, libraries: Path | None, file: Path) -> str:
    """What wpa_supplicant says of a file, for a radio that nobody has; it ends by itself."""
    environment = {**os.environ} if libraries is None else {**os.environ, "LD_LIBRARY_PATH": str(libraries)}
    words = [str(program), "-D", "nl80211", "-i", "atlantis-none", "-c", str(file)]
    done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=HANG_S, env=environment)
    assert done.returncode != 0
    return done.stdout + done.stderr


def test_each_radio_joins_its_vehicle(tmp_path: Path) -> None:
    base = part(tmp_path)
    text = files(base)["/etc/atlantis/radios/wlan1.conf"]
    assert {"country=PT", 'ssid="EXAMPLE-SPARUS"', "key_mgmt=WPA-PSK"} <= {*lines(text)}
    assert text.count("network={") == 1
    assert next(file.mode for file in base.configuration.files if file.path.endswith("wlan1.conf")) == "0600"
    assert {unit.name for unit in base.configuration.units if "radio" in unit.name} == {
        f"atlantis-radio@wlan{number}.service" for number in range(3)
    }
    assert "wpasupplicant" in {package.name for package in base.packages}


def test_role_data_contains_no_key(tmp_path: Path) -> None:
    told = part(tmp_path).as_dict()
    assert told["secrets"] == KEYS
    assert "-wifi" not in json.dumps(told).replace("@wifi", "")


def test_module_inserts_keys_and_never_shows_them(tmp_path: Path) -> None:
    told = part(tmp_path).as_dict()
    secrets = {word: f"EXAMPLE-{vehicle}-key" for word, vehicle in told["secrets"].items()}
    laid = {file.path: file for file in DesiredState.of({**told["configure"], "secrets": secrets}).files}
    radio = laid["/etc/atlantis/radios/wlan2.conf"]
    assert 'psk="EXAMPLE-mares-key"' in radio.content
    assert (radio.secret, radio.mode) == (True, "0600")
    assert not laid["/etc/nftables.conf"].secret
    assert not any("@wifi-key" in file.content for file in laid.values())


def test_vehicle_network_provides_only_an_address(tmp_path: Path) -> None:
    base = part(tmp_path, ("        client: {network: 10.70.2.0/24, address: 10.70.2.2}\n", ""))
    static = lines(files(base)["/etc/systemd/network/04-atlantis-radio-wlan0-girona500.network"])
    leased = lines(files(base)["/etc/systemd/network/04-atlantis-radio-wlan1-sparus.network"])
    assert "Address=10.70.1.2/24" in static
    assert not [line for line in static if line.startswith(("Gateway", "DNS", "DHCP", "SSID"))]
    assert {"DHCP=ipv4", "UseRoutes=no", "UseDNS=no", "UseNTP=no", "UseHostname=no"} <= {*leased}


def test_two_vehicles_on_one_radio_are_distinguished_by_ssid(tmp_path: Path) -> None:
    base = part(tmp_path, ("interface: wlan1", "interface: wlan0"), ("ssid: EXAMPLE-SPARUS", "ssid: 'a*b \"c'"))
    assert files(base)["/etc/atlantis/radios/wlan0.conf"].count("network={") == 2
    told = lines(files(base)["/etc/systemd/network/04-atlantis-radio-wlan0-sparus.network"])
    assert r'SSID="a\*b \"c"' in told
    assert "/etc/atlantis/radios/wlan1.conf" not in files(base)


def test_nothing_is_forwarded_between_robots(tmp_path: Path) -> None:
    text = files(part(tmp_path))["/etc/nftables.conf"]
    forward = text.partition("chain forward")[2]
    assert re.findall(r"^ *([io]ifname .*?) counter", forward, re.MULTILINE) == [
        "iifname { wlan0, wlan1, wlan2 } drop".removesuffix(" drop"),
        "oifname { wlan0, wlan1, wlan2 }",
    ]


def test_radio_without_a_key_is_left_to_a_person(tmp_path: Path) -> None:
    edits = [(f"        key: EXAMPLE-{name}-wifi\n", "") for name in ("girona500", "sparus", "mares")] + [
        (f"        client: {{network: 10.70.{n}.0/24, address: 10.70.{n}.2}}\n", "") for n in (1, 2, 3)
    ]
    base = part(tmp_path, *edits)
    assert not [path for path in files(base) if "radio" in path]
    assert "chain forward" not in files(base)["/etc/nftables.conf"]
    assert "/etc/systemd/system/atlantis-radio@.service" in base.configuration.absent
    assert base.as_dict()["secrets"] == {}


def test_rehearsal_notes_that_there_is_no_radio(tmp_path: Path) -> None:
    base = part(tmp_path, rehearsed=True)
    assert next(item.note for item in base.configuration.brought) == (
        "not rehearsed: wlan0 joins the access point of girona500; this machine has no radio"
    )


SUPPLICANTS = {
    "2.9": (BULLSEYE / "wpasupplicant" / "sbin" / "wpa_supplicant", BULLSEYE / "libssl1.1"),
    "2.10": (Path("/sbin/wpa_supplicant"), None),
}


@pytest.fixture(params=list(SUPPLICANTS))
def supplicant(request: pytest.FixtureRequest) -> tuple[Path, Path | None]:
    """wpa_supplicant of Debian 11 and of Debian 12, with the libraries that it needs."""
    program, packed = SUPPLICANTS[request.param]
    if not program.exists():
        pytest.skip(f"there is no wpa_supplicant {request.param} here")
    libraries = None if packed is None else next(packed.glob("usr/lib/*/libssl.so.1.1")).parent
    environment = {} if libraries is None else {"LD_LIBRARY_PATH": str(libraries)}
    said = subprocess.run([program, "-v"], check=False, capture_output=True, text=True, env=environment)
    assert f"wpa_supplicant v{request.param}\n" in said.stdout
    return program, libraries


@pytest.mark.parametrize(
    "edit",
    [
        ("auv", "auv"),
        ("ssid: EXAMPLE-SPARUS", "ssid: 'Olá \"é\" #1'"),
        ("ssid: EXAMPLE-SPARUS", "ssid: 'a \"b\" #1'"),
        ("        key: EXAMPLE-sparus-wifi\n", "        key: EXAMPLE-sparus-wifi\n        wpa: wpa3\n"),
        ("ssid: EXAMPLE-SPARUS\n", 'ssid: EXAMPLE-SPARUS\n        mac: "02:00:5E:00:FD:02"\n'),
        ("interface: wlan2", "interface: wlan1"),
    ],
    ids=["shipped", "accents", "quotes", "wpa3", "mac", "shared"],
)
def test_wpa_supplicant_accepts_every_file(
    supplicant: tuple[Path, Path | None], tmp_path: Path, edit: tuple[str, str]
) -> None:
    found = {
        path: text for path, text in files(part(tmp_path, edit)).items() if path.startswith("/etc/atlantis/radios")
    }
    assert found
    for path, text in found.items():
        file = tmp_path / Path(path).name
        file.write_text(text)
        said = read_by(*supplicant, file)
        assert "Failed to initialize driver" in said or "Could not" in said, said
        assert "Failed to read or parse" not in said
        assert not re.search(r"^Line \d+", said, re.MULTILINE), said


@pytest.mark.parametrize("word", ["country", "id_str", "ssid", "proto", "pairwise", "group", "key_mgmt", "ieee80211w"])
def test_wpa_supplicant_refuses_a_misspelt_key(supplicant: tuple[Path, Path | None], tmp_path: Path, word: str) -> None:
    text = files(part(tmp_path))["/etc/atlantis/radios/wlan0.conf"]
    file = tmp_path / "wlan0.conf"
    file.write_text(re.sub(rf"^( *){word}=", rf"\1{word}x=", text, flags=re.MULTILINE))
    assert f"unknown {'global' if word == 'country' else 'network'} field '{word}x" in read_by(*supplicant, file)


@pytest.mark.parametrize(("word", "accepted"), [("psk", True), ("pskx", False)])
def test_validator_of_the_gateway_detects_bad_files(tmp_path: Path, word: str, *, accepted: bool) -> None:
    base = part(tmp_path)
    radio = next(file for file in base.configuration.files if file.path.endswith("radios/wlan0.conf"))
    file = tmp_path / "wlan0.conf"
    file.write_text(radio.content.replace("    psk=", f"    {word}="))
    words = [item.replace("%s", str(file)) for item in radio.validate]
    done = subprocess.run(words, check=False, capture_output=True, text=True, timeout=HANG_S)
    assert (done.returncode == 0) is accepted, done.stdout + done.stderr
    assert ("unknown network field" in done.stdout) is not accepted
