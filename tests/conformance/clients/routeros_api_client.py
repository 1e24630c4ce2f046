"""RouterOS-api as its documentation shows it: a pool, resources with `get`, `add`, `set`, `remove`, `call`."""

from __future__ import annotations

import json
import ssl
import sys
from typing import Any

import routeros_api
from routeros_api.exceptions import RouterOsApiCommunicationError, RouterOsApiError

FILTER = "/ip/firewall/filter"


def main() -> None:
    """Do what the job says."""
    job = json.loads(sys.argv[1])
    print(json.dumps(globals()[job["do"]](job)))


def _pool(job: dict[str, Any], **more: Any) -> Any:
    context = ssl.create_default_context(cafile=job["ca"])
    context.check_hostname = False
    return routeros_api.RouterOsApiPool(
        job["host"],
        username=job["user"],
        password=job["password"],
        port=job["port"],
        plaintext_login=True,
        use_ssl=True,
        ssl_verify=True,
        ssl_verify_hostname=False,
        ssl_context=context,
        **more,
    )


def read(job: dict[str, Any]) -> Any:
    """Every menu, all sent before the first answer is read."""
    pool = _pool(job)
    api = pool.get_api()
    asked = {menu: api.get_resource(menu).call_async("print") for menu in job["menus"]}
    told = {menu: list(promise.get()) for menu, promise in asked.items()}
    pool.disconnect()
    return told


def queries(job: dict[str, Any]) -> Any:
    """Rows by equality, and commands with queries of their own."""
    api = _pool(job).get_api()
    rules = api.get_resource(FILTER)
    return {
        "and": [row["comment"] for row in rules.get(chain="input", protocol="icmp")],
        "none": list(rules.get(chain="nothing-like-it")),
        "query": [
            row["name"]
            for row in api.get_resource("/interface").call("print", {"proplist": "name"}, {"type": "bridge"})
        ],
        "binary": api.get_binary_resource("/system/identity").call("print")[0]["name"].decode(),
        "len": len(rules.get()),
    }


def refused(job: dict[str, Any]) -> Any:
    """What it makes of each refusal."""
    api = _pool(job).get_api()
    told = []
    for command, words in job["calls"]:
        menu, _, verb = command.rpartition("/")
        try:
            api.get_resource(menu).call(verb, words)
        except RouterOsApiCommunicationError as refusal:
            told.append([type(refusal).__name__, refusal.original_message.decode()])
        else:
            told.append(["accepted"])
    return told


def login(job: dict[str, Any]) -> Any:
    """A wrong password."""
    try:
        _pool({**job, "password": "guessed"}).get_api()
    except RouterOsApiError as refusal:
        return {"wrong": str(refusal)}
    return {"wrong": "accepted"}


def words(job: dict[str, Any]) -> Any:
    """Store texts in a comment, and read them back."""
    lists = _pool(job).get_api().get_resource("/ip/firewall/address-list")
    told = []
    for text in job["texts"]:
        row = lists.add(list="words", address="192.0.2.77", comment=text).done_message["ret"]
        told.append(lists.get(id=row)[0].get("comment", ""))
        lists.remove(id=row)
    return told


def tamper(job: dict[str, Any]) -> Any:
    """Add a rule, alter a comment, remove a row of the owner's, move a rule."""
    pool = _pool(job)
    api = pool.get_api()
    rules, addresses, names = (api.get_resource(menu) for menu in (FILTER, "/ip/address", "/ip/dns/static"))
    added = rules.add(chain="input", action="accept", comment=job["added"], src_address="10.9.9.9")
    addresses.set(id=addresses.get(comment=job["renamed"])[0]["id"], comment=job["comment"])
    names.remove(id=names.get(comment=job["removed"])[0]["id"])
    order = {row.get("comment"): row["id"] for row in rules.get()}
    rules.call("move", {"numbers": order[job["moved"]], "destination": order[job["before"]]})
    pool.disconnect()
    return added.done_message["ret"]


if __name__ == "__main__":
    main()
