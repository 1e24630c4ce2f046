"""A change of the network in a folder: what is staged, refused, confirmed, and taken back."""

# ruff: noqa: F401, F811 - `box` is a fixture

import errno
import json
from typing import Any

import pytest
from network_box import PATHS, Box, box, made, moved, settled, wish

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import network_change, network_guard
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.network_files import (
    FOLDER,
    NetworkComputer,
)

EVERY = pytest.mark.parametrize("by", list(PATHS))
CLOUD = "/etc/netplan/50-cloud-init.yaml"


@EVERY
def test_confirmed_change_persists_and_second_run_changes_nothing(box: Box, by: str) -> None:
    first = made(box, by)
    assert first.stage(check=True) is None
    assert box.text(PATHS[by]) is None
    enabled = ["unit systemd-networkd.service enabled"] if by == "networkd" else []
    assert first.changes == [f"file {PATHS[by]}", "file /etc/resolv.conf", *enabled]
    state = settled(box, by)
    assert state["held"]["eth0"] == ["10.64.1.10/24"]
    assert state["routes"] == [("10.64.1.1", "eth0")]
    assert state["files"][PATHS[by]] == wish(by).content
    box.time_passes()
    second = made(box, by)
    assert (second.stage(), second.changes, second.diff) == (None, [], [])
    box.power_cut()
    assert box.state() == state


@EVERY
def test_unconfirmed_change_is_rolled_back(box: Box, by: str) -> None:
    before = settled(box, by)
    change = made(box, by, **moved(by))
    name = change.stage()
    assert name is not None
    assert change.changes == [f"file {PATHS[by]}"]
    box.queued = False
    network_guard.apply(box.computer)
    assert box.held["eth0"] == ["10.64.1.77/24"]
    assert change.look(name, 0.0)["state"] == "pending"
    box.time_passes()
    assert box.state() == before
    why = "no new session reached 10.64.1.77 within 180 s"
    assert change.look(name, 0.0) == {"state": "rolled back", "why": why}
    assert change.confirm(name)["state"] == "rolled back"


@EVERY
def test_change_is_not_confirmed_without_a_responding_gateway(box: Box, by: str) -> None:
    before = settled(box, by)
    content = wish(by).content.replace("10.64.1.1}", "10.64.1.99}").replace("ateway=10.64.1.1\n", "ateway=10.64.1.99\n")
    content = content.replace("gateway 10.64.1.1\n", "gateway 10.64.1.99\n")
    change = made(box, by, content=content, gateway="10.64.1.99")
    name = change.stage()
    assert name is not None
    box.queued = False
    network_guard.apply(box.computer)
    why = "the gateway address 10.64.1.99 does not respond on eth0"
    assert change.confirm(name) == {"state": "pending", "again": False, "why": why}
    box.time_passes()
    assert box.state() == before
    assert change.look(name, 0.0) == {"state": "rolled back", "why": why}


@EVERY
def test_power_cut_before_confirmation_restores_the_previous_state(box: Box, by: str) -> None:
    before = settled(box, by)
    change = made(box, by, **moved(by))
    name = change.stage()
    assert name is not None
    box.queued = False
    network_guard.apply(box.computer)
    box.power_cut()
    assert box.state() == before
    why = "the computer was restarted before a new session had confirmed it"
    assert change.look(name, 0.0) == {"state": "rolled back", "why": why}


def test_older_session_cannot_confirm_the_change(box: Box, monkeypatch: pytest.MonkeyPatch) -> None:
    change = made(box, "networkd")
    name = change.stage()
    assert name is not None
    monkeypatch.setattr(network_change, "ssh_server_start_s", network_guard.boot_time().__float__)
    box.queued = False
    network_guard.apply(box.computer)
    assert change.confirm(name)["again"] is True
    monkeypatch.setattr(network_change, "ssh_server_start_s", network_guard.boot_time)
    assert change.confirm(name)["state"] == "confirmed"


def test_failed_tool_is_rolled_back_at_once(box: Box, monkeypatch: pytest.MonkeyPatch) -> None:
    before = settled(box, "netplan")
    change = made(box, "netplan", **moved("netplan"))
    name = change.stage()
    assert name is not None
    monkeypatch.setattr(box, "_netplan", lambda _words: NetworkComputer("/nowhere").run(("false",)))
    box.queued = False
    network_guard.apply(box.computer)
    assert box.state() == before
    assert change.look(name, 0.0)["why"].startswith("`netplan apply` failed")


def test_configuration_not_in_effect_is_applied(box: Box) -> None:
    settled(box, "ifupdown")
    box.routes = []
    change = made(box, "ifupdown")
    assert change.stage() is not None
    assert change.changes == ["network eth0 applied: there is no default route via 10.64.1.1 on eth0"]
    assert change.diff == []


def test_lan_address_moves_between_interfaces(box: Box) -> None:
    settled(box, "networkd")
    change = made(box, "networkd", interface="eth1", content=wish("networkd").content.replace("eth0", "eth1"))
    assert change.stage() is not None
    box.queued = False
    network_guard.apply(box.computer)
    assert box.held == {"eth0": [], "eth1": ["10.64.1.10/24"]}
    box.time_passes()
    assert box.held == {"eth0": ["10.64.1.10/24"], "eth1": []}


def test_pending_change_is_ended_before_another_begins(box: Box) -> None:
    settled(box, "netplan")
    assert made(box, "netplan", **moved("netplan")).stage() is not None
    again = made(box, "netplan")
    assert (again.stage(), again.changes) == (None, [])


CASES: dict[str, tuple[dict[str, Any], str, str]] = {
    "no prefix": ({"address": "10.64.1.10"}, "the address 10.64.1.10 has no prefix length", "10.64.1.10/24"),
    "no address": ({"address": "10.64.1.300/24"}, "is not valid", "like 10.64.1.10/24"),
    "gateway elsewhere": ({"gateway": "10.9.9.9"}, "10.9.9.9 cannot be the gateway of 10.64.1.10/24", "`lan`"),
    "no interface": (
        {"interface": "eth7"},
        "interface eth7 does not exist; existing interfaces: eth0, eth1",
        "interface",
    ),
}


@EVERY
@pytest.mark.parametrize("case", list(CASES))
def test_invalid_change_is_refused_before_anything_is_touched(box: Box, by: str, case: str) -> None:
    changes, said, hint = CASES[case]
    before = box.state()
    with pytest.raises(ModuleError) as caught:
        made(box, by, **changes).stage()
    assert said in caught.value.message
    assert hint in caught.value.hint
    assert box.state() == before
    assert box.text(f"{FOLDER}/pending") is None


def test_netplan_rejection_is_reported_in_its_own_words(box: Box) -> None:
    content = wish("netplan").content.replace("10.64.1.10/24", "10.64.1.10")
    with pytest.raises(ModuleError, match="is missing /prefixlength") as caught:
        made(box, "netplan", content=content).stage()
    assert "/etc/netplan/10-atlantis.yaml:8:18" in caught.value.message
    assert not box.timer


def test_missing_tool_is_reported(box: Box) -> None:
    (box.root / "usr/sbin/netplan").unlink()
    with pytest.raises(ModuleError, match="netplan, which is not installed on this computer") as caught:
        made(box, "netplan").stage()
    assert "apt-get install netplan.io" in caught.value.hint


OTHERS = {
    CLOUD: "network:\n  ethernets:\n    eth0:\n      dhcp4: true\n",
    "/etc/network/interfaces.d/lan": "auto eth0\niface eth0 inet dhcp\n",
    "/etc/systemd/network/20-wired.network": "[Match]\nName=en* eth*\n[Network]\nDHCP=yes\n",
    "/etc/NetworkManager/system-connections/wired.nmconnection": "[connection]\ninterface-name=eth0\n",
}


@EVERY
@pytest.mark.parametrize("path", list(OTHERS))
def test_conflicting_configuration_is_replaced_and_restored(box: Box, by: str, path: str) -> None:
    box.put("/etc/network/interfaces", "source /etc/network/interfaces.d/*\n")
    wants = box.root / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir(parents=True)
    (wants / "systemd-networkd.service").symlink_to("/lib/systemd/system/systemd-networkd.service")
    box.put(path, OTHERS[path])
    before = box.state()
    with pytest.raises(ModuleError) as caught:
        made(box, by).stage()
    assert path in caught.value.message
    assert f"`replaces: [{path}]`" in caught.value.hint
    assert box.state() == before

    change = made(box, by, replaces=[path])
    assert change.stage() is not None
    assert f"file {path} removed" in change.changes
    assert OTHERS[path] not in [one["before"] for one in change.diff]
    assert box.text(path) == OTHERS[path]
    box.queued = False
    network_guard.apply(box.computer)
    assert box.text(path) is None
    box.time_passes()
    assert box.text(path) == OTHERS[path]
    assert box.state() == before


def test_conflicting_file_added_later_is_reported(box: Box) -> None:
    settled(box, "netplan")
    box.put(CLOUD, OTHERS[CLOUD])
    change = made(box, "netplan")
    with pytest.raises(
        ModuleError, match=r"other files configure eth0, too, and would conflict: /etc/netplan/50-cloud-init\.yaml"
    ):
        change.stage()
    assert change.changes == []


@pytest.mark.parametrize(
    "text",
    [
        "[Match]\nName=eth1\n",
        "[Match]\nName=!eth0\n",
        "[Match]\nMACAddress=02:00:5e:00:01:99\n",
        "[Match]\nType=wlan\nName=wl*\n",
    ],
)
def test_a_file_of_another_interface_is_left_alone(box: Box, text: str) -> None:
    box.put("/etc/systemd/network/01-other.network", text)
    assert made(box, "networkd").stage() is not None


def test_foreign_entries_in_interfaces_are_preserved(box: Box) -> None:
    box.put("/etc/network/interfaces", "auto lo\niface lo inet loopback\nsource interfaces.d/*\n")
    box.put("/etc/network/interfaces.d/sonar", "iface eth1 inet static\n    address 192.168.0.2/24\n")
    with pytest.raises(ModuleError, match=r"lose their entries: eth1 \(/etc/network/interfaces.d/sonar\)") as caught:
        made(box, "ifupdown").stage()
    assert "by: networkd" in caught.value.hint
    assert made(box, "ifupdown", replaces=["/etc/network/interfaces"]).stage() is not None


def test_fresh_image_needs_no_change(box: Box) -> None:
    content = wish("ifupdown").content.replace("# Written by `provision`.", "# Written by `provision gateway image`.")
    box.put(PATHS["ifupdown"], content)
    box.put(
        "/etc/resolv.conf",
        "# Written by `provision gateway image`.\nsearch coastal.example.org\nnameserver 10.64.1.1\n",
    )
    box.held["eth0"], box.routes = ["10.64.1.10/24"], [("10.64.1.1", "eth0")]
    change = made(box, "ifupdown")
    assert (change.stage(), change.changes) == (None, [])


def test_resolver_file_is_left_to_systemd_resolved(box: Box) -> None:
    box.put("/lib/systemd/systemd-resolved", "")
    change = made(box, "netplan")
    change.stage()
    assert change.changes == [f"file {PATHS['netplan']}"]


def test_no_change_without_a_guarding_timer(box: Box, monkeypatch: pytest.MonkeyPatch) -> None:
    before = box.state()
    monkeypatch.setattr(box, "_systemd_run", lambda _words: NetworkComputer("/nowhere").run(("false",)))
    with pytest.raises(ModuleError, match="systemd does not start the rollback units; nothing was changed:"):
        made(box, "networkd").stage()
    assert box.state() == before
    assert not box.queued
    box.power_cut()
    assert box.text(f"{FOLDER}/pending") is None


def test_stored_state_is_readable_by_root_only(box: Box) -> None:
    made(box, "netplan").stage()
    kept = [place for place in (box.root / FOLDER[1:]).iterdir() if place.suffix == ".json"]
    assert {place.stat().st_mode & 0o777 for place in kept} == {0o600}
    assert json.loads((box.root / FOLDER[1:] / "previous.json").read_text())["files"]


# A disk that is full while the network is changed: told before, and no trap in the window.


# ruff: noqa: F401, F811 - `box` is a fixture


def full(monkeypatch: pytest.MonkeyPatch, path: str) -> None:
    write = NetworkComputer.write

    def refuse(self: NetworkComputer, name: str, *words: Any) -> None:  # noqa: ANN401
        if name.endswith(path):
            raise OSError(errno.ENOSPC, "No space left on device", name)
        write(self, name, *words)

    monkeypatch.setattr(NetworkComputer, "write", refuse)


def test_full_disk_is_reported_and_nothing_is_changed(box: Box, monkeypatch: pytest.MonkeyPatch) -> None:
    before = settled(box, "ifupdown")
    full(monkeypatch, "wanted.json")
    with pytest.raises(ModuleError, match="is full"):
        made(box, "ifupdown", **moved("ifupdown")).stage()
    assert box.state() == before
    assert box.text(f"{FOLDER}/pending") is None


@pytest.mark.parametrize("by", list(PATHS))
def test_disk_full_before_confirmation_keeps_access(box: Box, by: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = settled(box, by)
    change = made(box, by, **moved(by))
    name = change.stage()
    assert name is not None
    box.queued = False
    network_guard.apply(box.computer)
    with monkeypatch.context() as filled:
        full(filled, PATHS[by])
        with pytest.raises(OSError, match="No space left"):
            box.time_passes()
        assert (box.held, box.routes) == (before["held"], before["routes"])
        assert change.look(name, 0.0)["state"] == "pending"
    network_guard.roll_back(box.computer)
    assert box.state() == before
    assert change.look(name, 0.0)["state"] == "rolled back"
