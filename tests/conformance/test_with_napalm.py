"""napalm-ros 1.6 against the emulated router."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from intent import TAMPERED, is_put_right
from stand import PRESENT, Stand, stand

from atlantis_netcfg.routeros.rsc import parse

pytestmark = [PRESENT, pytest.mark.slow]

CLIENT = "napalm_client.py"
EXTRA = '/ip firewall address-list add address=192.0.2.9 comment="{}" list=words\n'


@pytest.fixture(scope="module")
def at(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    """The coastal router as `provision` leaves it."""
    with stand(tmp_path_factory.mktemp("stand")) as stood:
        stood.provision()
        yield stood


def test_getters_return_the_provisioned_state(at: Stand) -> None:
    asked = ["get_facts", "get_interfaces", "get_interfaces_ip", "get_interfaces_counters", "get_config", "get_users"]
    told = at.ask(CLIENT, do="getters", getters=[*asked, "get_environment", "get_arp_table", "get_lldp_neighbors"])
    facts = told["get_facts"]
    assert (facts["hostname"], facts["model"]) == ("coastal-router", "RB5009UPr+S+")
    assert (facts["os_version"], facts["vendor"]) == ("7.18.2 (stable)", "MikroTik")
    assert facts["serial_number"] == "TWINB537C6E0"
    ports = told["get_interfaces"]
    assert ports["ether2"]["description"] == "atlantis: 4g"
    assert (ports["ether7"]["is_enabled"], ports["ether8"]["is_enabled"]) == (False, True)
    assert told["get_interfaces_counters"].keys() == ports.keys()
    assert told["get_interfaces_ip"]["ether2"] == {"ipv4": {"10.10.1.2": {"prefix_length": 29}}}
    running = parse(told["get_config"]["running"], "config").statements
    assert running == parse(at.export(), "export").statements


def test_cli_runs_a_line_of_the_console(at: Stand) -> None:
    asked = [":put [/system/identity/get name]", ":put [/ip/address/print count-only]"]
    assert list(at.ask(CLIENT, do="cli", commands=asked).values()) == ["coastal-router", "5"]


def test_merged_config_is_drift_and_gets_repaired(at: Stand) -> None:
    before = at.export()
    script = (
        f'/ip firewall filter add chain=input action=accept src-address=10.9.9.9 comment="{TAMPERED["added"]}"\n'
        f'/ip address set [ find comment="{TAMPERED["renamed"]}" ] comment="{TAMPERED["comment"]}"\n'
        f'/ip dns static remove [ find comment="{TAMPERED["removed"]}" ]\n'
        f'/ip firewall filter move [ find comment="{TAMPERED["moved"]}" ]'
        f' destination=[ find comment="{TAMPERED["before"]}" ]\n'
    )
    told = at.ask(CLIENT, do="merge", text=script)
    assert f'comment="{TAMPERED["added"]}"' in told["difference"]
    assert told["pending"] is False
    is_put_right(at, before)


def test_candidate_with_a_syntax_error_changes_nothing(at: Stand) -> None:
    before = at.export()
    kind, words = at.ask(CLIENT, do="refused", text=EXTRA.format("never") + "/nonsense add\n")
    assert kind == "MergeConfigException"
    assert "bad command name nonsense" in words
    assert at.export() == before


def test_confirmed_commit_persists(at: Stand) -> None:
    before = at.export()
    assert at.ask(CLIENT, do="confirm", text=EXTRA.format("confirmed")) == [True, False]
    assert EXTRA.format("confirmed").split(" add ")[1].split(" comment")[0] in at.export()
    at.put_right()
    assert at.export() == before


def test_its_rollback_reboots_the_router(tmp_path: Path) -> None:
    """Where we take a change back in the running system, it restores a backup."""
    with stand(tmp_path) as at:
        at.provision()
        before = at.export()
        assert at.ask(CLIENT, do="rollback", text=EXTRA.format("taken back")) == {"is_alive": False}
        at.twins.do("coastal-router", "restart")
        assert at.export() == before
