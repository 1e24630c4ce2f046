"""community.routeros out of the PyPI package `ansible` 12.3 against the emulated router."""

from collections.abc import Iterator

import pytest
from intent import MENUS, NOT_IN_COMMUNITY, PINGS, TAMPERED, is_put_right, shortfalls
from stand import PRESENT, STRANGER, Stand, stand

from atlantis_netcfg.routeros.rsc import parse
from playbooks import intent_tasks, path_of, play

pytestmark = [PRESENT, pytest.mark.slow]


@pytest.fixture
def at(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    """The coastal router as `provision` leaves it."""
    with stand(tmp_path_factory.mktemp("stand")) as stood:
        stood.provision()
        yield stood


@pytest.mark.parametrize("half", [0, 1])
def test_api_modify_with_the_same_intent_changes_nothing(at: Stand, half: int) -> None:
    """Its table knows every menu that the template emits, and every field."""
    before = at.export()
    tasks = intent_tasks()[half::2]
    returned = play(at, tasks)
    assert len(returned) == len(tasks)
    assert [name for name, one in returned.items() if one["changed"]] == []
    assert at.export() == before


def test_api_info_reads_the_provisioned_state(at: Stand) -> None:
    wanted = {"handle_disabled": "omit", "hide_defaults": False}
    each = "{{ item }}"
    loop = {
        "name": "all",
        "community.routeros.api_info": {"path": each, **wanted},
        "loop": [path_of(menu) for menu in MENUS],
    }
    found = play(at, [loop])["all"]["results"]
    assert shortfalls({menu: one["result"] for menu, one in zip(MENUS, found, strict=True)}, NOT_IN_COMMUNITY) == []


def test_changes_by_its_modules_are_drift_and_get_repaired(at: Stand) -> None:
    before = at.export()
    rules, address = "ip firewall filter", "10.10.1.2/29"
    add = f'chain=input action=accept src-address=10.9.9.9 comment="{TAMPERED["added"]}"'
    ids = {"path": rules, "extended_query": {"attributes": [".id", "comment"]}}
    moved, before_it = (
        f"{{{{ (ids.msg | selectattr('comment', 'defined')"
        f" | selectattr('comment', 'eq', '{TAMPERED[which]}'))[0]['.id'] }}}}"
        for which in ("moved", "before")
    )
    returned = play(
        at,
        [
            {"name": "add", "community.routeros.api": {"path": rules, "add": add}},
            {
                "name": "rename",
                "community.routeros.api_modify": {
                    "path": "ip address",
                    "data": [{"address": address, "interface": "ether2", "comment": TAMPERED["comment"]}],
                },
            },
            {
                "name": "find",
                "community.routeros.api_find_and_modify": {
                    "path": "ip dns static",
                    "find": {"comment": TAMPERED["removed"]},
                    "values": {"comment": "to be removed"},
                    "require_matches_min": 1,
                },
            },
            {
                "name": "names",
                "community.routeros.api": {
                    "path": "ip dns static",
                    "extended_query": {
                        "attributes": [".id", "comment"],
                        "where": [{"attribute": "comment", "is": "==", "value": "to be removed"}],
                    },
                },
                "register": "names",
            },
            {
                "name": "remove",
                "community.routeros.api": {"path": "ip dns static", "remove": "{{ names.msg[0]['.id'] }}"},
            },
            {"name": "ids", "community.routeros.api": ids, "register": "ids"},
            {
                "name": "move",
                "community.routeros.api": {"path": rules, "cmd": f"move numbers={moved} destination={before_it}"},
            },
        ],
    )
    assert {"add", "rename", "find", "remove"} <= {name for name, one in returned.items() if one["changed"]}
    is_put_right(at, before)


def test_api_queries_and_refusals(at: Stand) -> None:
    returned = play(
        at,
        [
            {
                "name": "query",
                "community.routeros.api": {
                    "path": "ip firewall filter",
                    "query": "comment chain WHERE chain == output",
                },
            },
            {
                "name": "refused",
                "community.routeros.api": {"path": "ip address", "add": "address=nonsense interface=ether1"},
                "register": "refused",
                "failed_when": "'invalid value for argument address' not in refused.msg | string",
            },
            {
                "name": "extended",
                "community.routeros.api": {
                    "path": "ip firewall filter",
                    "extended_query": {
                        "attributes": ["comment", "chain", "protocol"],
                        "where": [
                            {"attribute": "chain", "is": "==", "value": "input"},
                            {"attribute": "protocol", "is": "==", "value": "icmp"},
                        ],
                    },
                },
            },
        ],
    )
    assert [row["comment"] for row in returned["extended"]["msg"]] == PINGS
    satellite = ["atlantis: satellite, the terminal itself", "atlantis: satellite, allow-list"]
    assert [row["comment"] for row in returned["query"]["msg"]] == satellite


def test_command_and_facts_over_ssh(at: Stand) -> None:
    """Not its subset `routing`: that asks for `/routing bgp peer`, which RouterOS 7 does not have."""
    returned = play(
        at,
        [
            {
                "name": "command",
                "community.routeros.command": {"commands": ["/system identity print", "/export show-sensitive"]},
            },
            {"name": "facts", "community.routeros.facts": {"gather_subset": ["hardware", "interfaces", "config"]}},
        ],
        ansible_connection="ansible.netcommon.network_cli",
        ansible_network_os="community.routeros.routeros",
        ansible_host="127.0.0.1",
        ansible_port=at.ready["ssh"],
        ansible_user=f"{STRANGER.name}+cet512w",
        ansible_password=STRANGER.password,
    )
    identity, export = returned["command"]["stdout"]
    assert identity.strip() == "name: coastal-router"
    assert parse(export, "export").statements == parse(at.export(), "export").statements
    facts = returned["facts"]["ansible_facts"]
    assert facts["ansible_net_hostname"] == "coastal-router"
    assert facts["ansible_net_version"].startswith("7.18.2")
    assert facts["ansible_net_model"].strip() == "RB5009UPr+S+"
    assert facts["ansible_net_serialnum"].strip() == "TWINB537C6E0"
    assert {"ether1", "bridge-lan", "ovpn-scc"} <= set(facts["ansible_net_interfaces"])
    assert "/ip firewall filter" in facts["ansible_net_config"]
