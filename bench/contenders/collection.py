"""The collection community.routeros: a playbook with one `api_modify` task for each menu."""

from __future__ import annotations

import json
import re
import subprocess
from functools import cache
from typing import TYPE_CHECKING, Any

import yaml

from bench import strangers
from bench.job import Command, Job, Scenario

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["Collection"]

_VERSION = "7.18.2"
"""Of the twin: the collection's table depends on it."""
_ALSO: Mapping[str, Mapping[str, str]] = {"system logging action": {"target": "memory"}}
"""What the collection wants to see beside our words: all declared actions of the log go to memory."""
_WHICH = (
    "import json, ansible_collections.community.routeros as here, pathlib;"
    "print(json.loads((pathlib.Path(list(here.__path__)[0]) / 'MANIFEST.json').read_text())"
    "['collection_info']['version'])"
)


class Collection:
    """Connection in `module_defaults` of the group `api`, checked TLS, entries that we own entirely in their order."""

    name = "community.routeros"
    title = "community.routeros, api_modify"

    def missing(self) -> str | None:
        """Whether it is installed."""
        return strangers.absent("ansible")

    def version(self) -> str:
        """Those of collection and Ansible."""
        found = _ask("-c", _WHICH).strip()
        return f"community.routeros {found} (ansible-core {strangers.version('ansible-core')})"

    def command(self, job: Job) -> Command:
        """Write playbook and inventory, and run them as its pages show."""
        left_out: list[str] = []
        tasks = [task for menu in job.declared.menus() if (task := _task(menu, left_out)) is not None]
        play = {
            "name": "The coastal router",
            "hosts": "router",
            "gather_facts": False,
            "module_defaults": {"group/community.routeros.api": _connection(job)},
            "tasks": tasks,
        }
        (job.folder / "play.yml").write_text(yaml.safe_dump([play], sort_keys=False), encoding="utf-8")
        host = {"ansible_connection": "local", "ansible_python_interpreter": strangers.python()}
        hosts = {"all": {"hosts": {"router": host}}}
        (job.folder / "hosts.yml").write_text(yaml.safe_dump(hosts), encoding="utf-8")
        notes = [f"{len(tasks)} tasks; no safe mode, no reading back"]
        if left_out:
            notes.append(f"its ARP table {_VERSION} lacks, so it does not do: {', '.join(left_out)}")
        words = ("-m", "ansible", "playbook", "-i", "hosts.yml", "play.yml")
        (job.folder / "ansible.cfg").write_text("[defaults]\n", encoding="utf-8")
        return Command((strangers.python(), *words), {"ANSIBLE_CONFIG": "ansible.cfg"}, tuple(notes))

    def notes_of(self, scenario: Scenario, text: str) -> tuple[str, ...]:
        """Tasks that call themselves changed although there was nothing to do."""
        if scenario is not Scenario.NOTHING:
            return ()
        tasks = re.findall(r"TASK \[(.*?)\] \*+\nchanged:", text)
        return (f"still reports as changed: {', '.join(tasks)}",) if tasks else ()


def _connection(job: Job) -> dict[str, Any]:
    _, user, password = job.declared.access
    return {
        "hostname": job.host,
        "port": job.port,
        "username": user,
        "password": password,
        "tls": True,
        "validate_certs": True,
        "ca_path": str(job.ca),
        "timeout": 120,
    }


def _task(menu: Mapping[str, Any], left_out: list[str]) -> dict[str, Any] | None:
    """One task that brings a menu to its declared rows; None for a menu that the collection does not know."""
    path = menu["path"].strip("/").replace("/", " ")
    known = _known().get(path)
    if known is None:
        left_out.append(f"/{path}")
        return None
    strange = sorted({name for row in menu["rows"] for name in row} - set(known))
    left_out += [f"{name} of /{path}" for name in strange]
    data = [{**_row(row, known), **_ALSO.get(path, {})} for row in menu["rows"]]
    arguments: dict[str, Any] = {"path": path, "data": data}
    if menu["shape"] == "list" and (menu["entire"] or menu["ordered"]):
        arguments["handle_absent_entries"] = "remove" if menu["entire"] else "ignore"
        arguments["handle_entries_content"] = "remove_as_much_as_possible"
        arguments["ensure_order"] = bool(menu["ordered"] and menu["entire"])
    return {"name": f"/{path}", "community.routeros.api_modify": arguments}


def _row(row: Mapping[str, str | None], known: list[str]) -> dict[str, str | int | bool | None]:
    return {name: _typed(value) for name, value in row.items() if name in known}


def _typed(value: str | None) -> str | int | bool | None:
    """Numbers and truth values as in its examples: librouteros, below it, casts what the device says the same way."""
    if value in ("yes", "no"):
        return value == "yes"
    return int(value) if value is not None and value.isdecimal() and str(int(value)) == value else value


@cache
def _known() -> dict[str, list[str]]:
    table: dict[str, list[str]] = json.loads(_ask(strangers.script("collection_paths.py"), _VERSION))
    return table


def _ask(*words: str) -> str:
    return subprocess.run(  # noqa: S603 - our own programs
        [strangers.python(), *words], capture_output=True, text=True, check=True
    ).stdout
