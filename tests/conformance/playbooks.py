"""Playbooks of community.routeros as its guides show them: what they say of our intent, and how they are run."""

import json
import subprocess
from collections.abc import Mapping, Sequence
from typing import Any

import yaml
from intent import MENUS, NOT_IN_COMMUNITY
from stand import STRANGERS, Stand, environment, text
from waiting import HANG_S

from atlantis_netcfg.routeros import desired
from atlantis_netcfg.routeros.menus import MENUS as TABLE
from atlantis_netcfg.routeros.menus import Shape

__all__ = ["intent_tasks", "menu_of", "path_of", "play"]

_POE = ("poe-out", "poe-priority")
_ALSO = {"memory": {"target": "memory"}}
"""Its table asks for the target of a log action, which we leave as the factory has it."""


def path_of(menu: str) -> str:
    """As the collection spells a menu."""
    return menu.strip("/").replace("/", " ")


def menu_of(path: str) -> str:
    """As we spell it."""
    return f"/{path.replace(' ', '/')}"


def intent_tasks() -> list[dict[str, Any]]:
    """One `api_modify` for each menu of the declared state; what is entirely ours in its order, the rest kept.

    PoE has a menu of its own: in `/interface/ethernet` the collection reports a written-out `poe-out=auto-on` as
    changed for ever, since that is the value by which it removes.
    """
    state = desired.read(text()).items
    power = [
        {"name": row["default-name"], **{name: row[name] for name in _POE if name in row}}
        for row in (item.values for item in state["/interface/ethernet"])
        if "poe-out" in row
    ]
    rows = {menu: [dict(item.values) for item in state[menu]] for menu in MENUS}
    rows["/interface/ethernet"] = [
        {name: value for name, value in row.items() if name not in _POE} for row in rows["/interface/ethernet"]
    ]
    return [*(_task(menu, some) for menu, some in rows.items()), _task("/interface/ethernet/poe", power)]


def _task(menu: str, rows: Sequence[Mapping[str, str | None]]) -> dict[str, Any]:
    unnamed = NOT_IN_COMMUNITY.get(menu, ())
    data = [
        {
            **{name: name == "blackhole" or _typed(value) for name, value in row.items() if name not in unnamed},
            **_ALSO.get(str(row.get("name")), {}),
        }
        for row in rows
    ]
    arguments: dict[str, Any] = {"path": path_of(menu), "data": data}
    known = TABLE.get(menu)
    if known is not None and known.shape is Shape.LIST and menu in desired.read(text()).entire:
        arguments["handle_absent_entries"] = "remove"
        arguments["handle_entries_content"] = "remove_as_much_as_possible"
        arguments["ensure_order"] = known.is_ordered
    return {"name": path_of(menu), "community.routeros.api_modify": arguments}


def _typed(value: str | None) -> str | int | bool | None:
    """Numbers and truth values as in its examples."""
    if value in ("yes", "no"):
        return value == "yes"
    return int(value) if value is not None and value.isdecimal() and str(int(value)) == value else value


def play(at: Stand, tasks: Sequence[Mapping[str, Any]], **host: str | int) -> dict[str, Any]:
    """Run tasks on the router by ansible-playbook; what each of them returned, by its name."""
    job = at.job()
    access = {
        "hostname": job["host"],
        "port": job["port"],
        "username": job["user"],
        "password": job["password"],
        "tls": True,
        "validate_certs": True,
        "ca_path": job["ca"],
        "encoding": "UTF-8",
    }
    defaults = {"group/community.routeros.api": access}
    book = [{"hosts": "router", "gather_facts": False, "module_defaults": defaults, "tasks": list(tasks)}]
    local = {"ansible_connection": "local", "ansible_python_interpreter": str(STRANGERS / "bin" / "python")}
    hosts = {"all": {"hosts": {"router": {**local, **host}}}}
    folder = at.folder
    (folder / "play.yml").write_text(yaml.safe_dump(book, sort_keys=False, allow_unicode=True), encoding="utf-8")
    (folder / "hosts.yml").write_text(yaml.safe_dump(hosts), encoding="utf-8")
    settings = {
        "ANSIBLE_STDOUT_CALLBACK": "ansible.posix.json",
        "ANSIBLE_PIPELINING": "1",
        "ANSIBLE_HOST_KEY_CHECKING": "0",
        "ANSIBLE_DEPRECATION_WARNINGS": "0",
    }
    done = subprocess.run(
        [str(STRANGERS / "bin" / "ansible-playbook"), "-i", "hosts.yml", "play.yml"],
        env={**environment(folder), **settings, "LC_ALL": "C.UTF-8"},
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=False,
    )
    assert done.stdout.lstrip().startswith("{"), f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    told = json.loads(done.stdout)["plays"][0]["tasks"]
    returned = {one["task"]["name"]: one["hosts"]["router"] for one in told if "router" in one["hosts"]}
    failed = {name: one.get("msg") for name, one in returned.items() if one.get("failed")}
    assert (failed, done.returncode) == ({}, 0), f"{failed}\n{done.stderr}"
    return returned
