"""librouteros as its documentation shows it: `connect`, `path`, `select`/`where`, `add`, `update`, `remove`, calls."""

from __future__ import annotations

import json
import ssl
import sys
from typing import Any

from librouteros import connect
from librouteros.exceptions import MultiTrapError, TrapError
from librouteros.login import token
from librouteros.query import And, Key, Or

FILTER = ("ip", "firewall", "filter")


def main() -> None:
    """Do what the job says."""
    job = json.loads(sys.argv[1])
    print(json.dumps(globals()[job["do"]](job)))


def _open(job: dict[str, Any], **more: Any) -> Any:
    context = ssl.create_default_context(cafile=job["ca"])
    context.check_hostname = False
    return connect(
        host=job["host"],
        port=job["port"],
        username=job["user"],
        password=job["password"],
        ssl_wrapper=context.wrap_socket,
        encoding="utf-8",
        **more,
    )


def read(job: dict[str, Any]) -> Any:
    """Every menu, all fields."""
    api = _open(job)
    return {menu: list(api.path(*menu.strip("/").split("/"))) for menu in job["menus"]}


def queries(job: dict[str, Any]) -> Any:
    """Chosen fields of chosen rows."""
    api = _open(job)
    chain, action, comment = Key("chain"), Key("action"), Key("comment")
    rules = api.path(*FILTER)
    icmp = And(chain == "input", Key("protocol") == "icmp")
    return {
        "and": [row["comment"] for row in rules.select(comment).where(icmp)],
        "or": [row["action"] for row in rules.select(action).where(Or(action == "log", action == "return"))],
        "in": [row["comment"] for row in rules.select(comment).where(chain.In("output"))],
        "none": list(rules.select(comment).where(chain == "nothing-like-it")),
        "fields": sorted({name for row in rules.select(chain, action) for name in row}),
        "raw": [row["name"] for row in api.rawCmd("/interface/print", "?type=bridge", "=.proplist=name")],
        "len": len(tuple(rules)),
    }


def refused(job: dict[str, Any]) -> Any:
    """What it makes of each refusal."""
    api = _open(job)
    told = []
    for command, words in job["calls"]:
        try:
            list(api(command, **words))
        except TrapError as trap:
            told.append(["TrapError", trap.category, trap.message])
        except MultiTrapError as traps:
            told.append(["MultiTrapError", *(trap.message for trap in traps.errors)])
        else:
            told.append(["accepted"])
    return told


def login(job: dict[str, Any]) -> Any:
    """A wrong password, and the way to log in before 6.43."""
    told = {}
    try:
        _open({**job, "password": "guessed"})
    except TrapError as trap:
        told["wrong"] = trap.message
    api = _open(job, login_method=token)
    told["old"] = next(iter(api.path("system", "identity")))["name"]
    api.close()
    return told


def words(job: dict[str, Any]) -> Any:
    """Store texts in a comment, and read them back."""
    api = _open(job)
    lists = api.path("ip", "firewall", "address-list")
    told = []
    for text in job["texts"]:
        row = lists.add(list="words", address="192.0.2.77", comment=text)
        (found,) = lists.select(Key(".id"), Key("comment")).where(Key(".id") == row)
        told.append(found.get("comment", ""))
        lists.remove(row)
    return told


def tamper(job: dict[str, Any]) -> Any:
    """Add a rule, alter a comment, remove a row of the owner's, move a rule."""
    api = _open(job)
    rules, addresses, names = api.path(*FILTER), api.path("ip", "address"), api.path("ip", "dns", "static")
    added = rules.add(chain="input", action="accept", comment=job["added"], **{"src-address": "10.9.9.9"})
    (address,) = addresses.select(Key(".id")).where(Key("comment") == job["renamed"])
    addresses.update(**{".id": address[".id"], "comment": job["comment"]})
    (name,) = names.select(Key(".id")).where(Key("comment") == job["removed"])
    names.remove(name[".id"])
    order = {row.get("comment"): row[".id"] for row in rules}
    tuple(rules("move", numbers=order[job["moved"]], destination=order[job["before"]]))
    api.close()
    return added


if __name__ == "__main__":
    main()
