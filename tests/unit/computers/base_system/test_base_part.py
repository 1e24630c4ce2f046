"""Part `gateway_base`: what the shipped inventory's gateway gets, and what a declaration changes of it."""

import ast
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules.configure import ARGUMENTS
from atlantis_netcfg.computers.base import GatewayBase, gateway_base
from atlantis_netcfg.inventory import load

SHIPPED = Path(__file__).parents[4] / "inventory"
GATEWAY = "coastal-gateway"


def part(
    tmp_path: Path, device: str = "", pilot: tuple[str, str] = ("", ""), site: tuple[str, str] = ("", "")
) -> GatewayBase:
    """The shipped inventory with lines added to the gateway's device, and words of pilot and site exchanged."""
    made = tmp_path / "inventory"
    shutil.copytree(SHIPPED, made)
    for path, (old, new) in (("group_vars/all/pilot.yml", pilot), ("group_vars/coastal.yml", site)):
        text = (made / path).read_text()
        assert old in text
        (made / path).write_text(text.replace(old, new) if old else text)
    host = made / "host_vars" / f"{GATEWAY}.yml"
    host.write_text(host.read_text() + device)
    declaration = load(made)
    return gateway_base(declaration, declaration.hosts[GATEWAY])


def text(base: GatewayBase, path: str) -> str:
    return next(file.content for file in base.configuration.files if file.path == path)


def test_result_is_plain_json_without_templates(tmp_path: Path) -> None:
    told = part(tmp_path).as_dict()
    assert json.loads(json.dumps(told)) == told
    assert told.keys() == {"packages", "configure", "secrets", "own_secret", "service_secrets", "qualify_secret"}
    assert {"name": "chrony", "version": None} in told["packages"]["packages"]
    assert "{{" not in json.dumps(told)
    assert "{%" not in json.dumps(told)


def test_time_comes_from_nearby_servers_and_never_over_the_vpn(tmp_path: Path) -> None:
    conf = text(part(tmp_path), "/etc/chrony/chrony.conf")
    assert re.findall(r"^(server \S+|local.*|allow.*|makestep.*|refclock.*)", conf, re.MULTILINE) == [
        *("server 10.64.1.1", "server 192.0.2.123", "server 192.0.2.124", "local stratum 10 orphan"),
        *("allow 10.64.1.0/24", "makestep 1 3"),
    ]


@pytest.mark.parametrize(
    ("gps", "line"),
    [
        ("{source: shm}", "refclock SHM 0 refid GPS poll 4 delay 0.5"),
        ("{source: socket, device: ttyUSB1}", "refclock SOCK /run/chrony.ttyUSB1.sock refid GPS poll 4 delay 0.5"),
    ],
)
def test_gps_receiver_provides_the_time(tmp_path: Path, gps: str, line: str) -> None:
    base = part(tmp_path, f"  gps: {gps}\n")
    assert line in text(base, "/etc/chrony/chrony.conf").splitlines()
    assert 'GPSD_OPTIONS="-n"' in text(base, "/etc/default/gpsd")
    assert "gpsd" in {package.name for package in base.packages}
    assert "gpsd.service" in {unit.name for unit in base.configuration.units}


def test_ssh_access_is_limited_to_declared_networks(tmp_path: Path) -> None:
    base = part(
        tmp_path, "  ssh: {port: 2222}\n", site=("admit: [10.64.101.0/24,", "admit: [10.64.101.0/25, 192.0.2.64/26,")
    )
    rules = text(base, "/etc/nftables.conf")
    assert "ip saddr { 10.64.1.0/24, 10.64.101.0/25, 10.80.0.0/16, 192.0.2.64/26 } tcp dport 2222 accept" in rules
    way_in = base.configuration.way_in
    assert way_in is not None
    assert way_in.admit == ("10.64.1.0/24", "10.64.101.0/25", "10.80.0.0/16", "192.0.2.64/26")
    assert (way_in.port, way_in.key) == (2222, True)
    assert "site.management.admit" in way_in.hint


@pytest.mark.parametrize(
    ("pilot", "rule"),
    [
        (("domain: 0 ", "domain: 42 "), "ip saddr { 10.64.1.0/24, 10.80.0.0/16 } udp dport 17900-17929 accept"),
        (("participants: 10 ", "participants: 3 "), "udp dport 7400-7415 accept"),
    ],
)
def test_dds_ports_are_open_to_lan_and_vpn(tmp_path: Path, pilot: tuple[str, str], rule: str) -> None:
    assert rule in text(part(tmp_path, pilot=pilot), "/etc/nftables.conf")


def test_dds_ports_are_closed_without_dds() -> None:
    declared = load(SHIPPED)
    silent = replace(declared, pilot=declared.pilot.model_copy(update={"dds": None}))
    assert "DDS" not in text(gateway_base(silent, silent.hosts[GATEWAY]), "/etc/nftables.conf")


def test_redirects_and_router_advertisements_are_ignored(tmp_path: Path) -> None:
    base = part(tmp_path, "  network: {by: networkd, interface: eth7}\n")
    lines = text(base, "/etc/sysctl.d/60-atlantis.conf").splitlines()
    for interface in ("all", "default", "*", "eth7", "wlan0"):
        assert f"-net.ipv4.conf.{interface}.accept_redirects = 0" in lines
        assert f"-net.ipv6.conf.{interface}.accept_ra = 0" in lines
    rules = text(base, "/etc/nftables.conf")
    assert rules.index("nd-router-advert, nd-redirect }") < rules.index("icmp type redirect")
    assert rules.index("icmp type redirect") < rules.index("ct state established,related accept")
    assert "systemd-resolved.service" in {unit.name for unit in base.configuration.units}


def test_watchdog_is_set_if_declared(tmp_path: Path) -> None:
    path = "/etc/systemd/system.conf.d/atlantis-watchdog.conf"
    without, declared = part(tmp_path / "a"), part(tmp_path / "b", "  watchdog_s: 30\n")
    assert path in without.configuration.absent
    assert path not in declared.configuration.absent
    assert "RuntimeWatchdogSec=30\n" in text(declared, path)


def test_cloud_init_stays_disabled(tmp_path: Path) -> None:
    """Of its two files the one that switches it on has precedence, and the kernel's command line over both."""
    made = part(tmp_path).configuration
    assert "/etc/cloud/cloud-init.disabled" in [file.path for file in made.files]
    assert "/etc/cloud/cloud-init.enabled" in made.absent
    check, *_ = made.checks
    words = tmp_path / "cmdline"
    for cmdline, code in (("quiet", 0), ("quiet cloud-init=enabled ro", 1), ("cloud-init=disabled", 0)):
        words.write_text(cmdline)
        script = check.run[2].replace("/proc/cmdline", str(words)).replace("command -v cloud-init", "true")
        assert subprocess.run(["sh", "-c", script], check=False).returncode == code
        script = check.run[2].replace("/proc/cmdline", str(words)).replace("command -v cloud-init", "false")
        assert subprocess.run(["sh", "-c", script], check=False).returncode == 0


def test_nothing_is_downloaded_automatically_over_metered_links(tmp_path: Path) -> None:
    apt = "/etc/apt/apt.conf.d/90atlantis"
    metered = text(part(tmp_path / "a"), apt)
    assert 'APT::Periodic::Update-Package-Lists "0";' in metered
    assert "(4g, satellite)" in metered
    assert 'Unattended-Upgrade::Automatic-Reboot "false";' in metered


def test_names_resolve_without_a_server(tmp_path: Path) -> None:
    hosts = text(part(tmp_path), "/etc/hosts").splitlines()
    assert f"127.0.1.1 {GATEWAY}.coastal.example.org {GATEWAY}" in hosts
    assert "10.64.1.22 sparus sparus.coastal.example.org" in hosts
    assert "10.80.0.22 te4sea-gateway" in hosts
    assert not [line for line in hosts if line.startswith("10.64.1.10 ")]


# What `ansible-doc` shows of the modules can be read, and is what they take.


MODULES = Path(__file__).parents[4] / "atlantis_netcfg/ansible_collections/atlantis/netcfg/plugins/modules"
TEXTS = {"DOCUMENTATION", "EXAMPLES", "RETURN"}


def told(module: str) -> dict[str, Any]:
    found = {}
    for node in ast.parse((MODULES / f"{module}.py").read_text()).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id in TEXTS:
            found[node.targets[0].id] = yaml.safe_load(ast.literal_eval(node.value))
    return found


def shape(options: dict[str, Any], below: str) -> dict[str, Any]:
    return {
        name: (
            row["type"],
            row.get("elements"),
            row.get("default"),
            row.get("required", False),
            shape(row.get(below, {}), below),
        )
        for name, row in options.items()
    }


@pytest.mark.parametrize("module", [path.stem for path in sorted(MODULES.glob("*.py"))])
def test_module_documentation_is_valid(module: str) -> None:
    texts = told(module)
    assert texts.keys() == TEXTS
    assert texts["DOCUMENTATION"]["module"] == module
    assert texts["EXAMPLES"][0].keys() >= {"name", f"atlantis.netcfg.{module}"}


def test_documented_options_match_the_arguments() -> None:
    assert shape(told("configure")["DOCUMENTATION"]["options"], "suboptions") == shape(ARGUMENTS, "options")
