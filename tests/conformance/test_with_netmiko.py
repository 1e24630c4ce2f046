"""netmiko 4.8 (`mikrotik_routeros`) against the console of the emulated router."""

from collections.abc import Iterator

import pytest
from intent import TAMPERED, is_put_right
from stand import PRESENT, Stand, stand

from atlantis_netcfg.routeros.rsc import parse

pytestmark = [PRESENT, pytest.mark.slow]

CLIENT = "netmiko_client.py"
RULES = "/ip firewall filter"


@pytest.fixture(scope="module")
def at(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    """The coastal router as `provision` leaves it."""
    with stand(tmp_path_factory.mktemp("stand")) as stood:
        stood.provision()
        yield stood


def test_reads_the_provisioned_state(at: Stand) -> None:
    asked = ["/system identity print", ":put [/ip address print count-only]", "/export show-sensitive"]
    prompt, identity, addresses, export = at.ask(CLIENT, do="commands", commands=asked)
    assert prompt == "[stranger@coastal-router] >"
    assert (identity, addresses) == ("name: coastal-router", "5")
    assert parse(export, "export").statements == parse(at.export(), "export").statements


def test_its_templates_read_the_tables(at: Stand) -> None:
    asked = ["/system identity print", "/system routerboard print", "/ip address print"]
    identity, (board,), addresses = at.ask(CLIENT, do="tables", commands=asked)
    assert identity == [{"name": "coastal-router"}]
    assert (board["board_name"], board["serial_number"]) == ("RB5009UPr+S+", "TWINB537C6E0")
    wanted = [("10.10.0.2", "29", "ether1", "atlantis: wifi-ptp"), ("10.64.1.1", "24", "bridge-lan", "atlantis: LAN")]
    assert set(wanted) < {(row["ip"], row["subnet"], row["interface"], row["comment"]) for row in addresses}


def test_refusals_have_the_text_of_the_console(at: Stand) -> None:
    asked = ["/ip address add address=nonsense interface=ether1", "/nonsense", "/ip address remove 99", "/ip address ("]
    _, value, command, item, syntax = at.ask(CLIENT, do="commands", commands=asked)
    assert value == "invalid value for argument address"
    assert command == "bad command name nonsense (line 1 column 2)"
    assert item == "no such item"
    assert "(line 1 column" in syntax
    assert at.ask(CLIENT, do="login") == "NetmikoAuthenticationException"


def test_typed_commands_are_drift_and_get_repaired(at: Stand) -> None:
    before = at.export()
    typed = [
        f'{RULES} add chain=input action=accept src-address=10.9.9.9 comment="{TAMPERED["added"]}"',
        f'/ip address set [find comment="{TAMPERED["renamed"]}"] comment="{TAMPERED["comment"]}"',
        f'/ip dns static remove [find comment="{TAMPERED["removed"]}"]',
        f'{RULES} move [find comment="{TAMPERED["moved"]}"] destination=[find comment="{TAMPERED["before"]}"]',
    ]
    said = at.ask(CLIENT, do="config", commands=typed)
    assert "bad command" not in said
    is_put_right(at, before)
