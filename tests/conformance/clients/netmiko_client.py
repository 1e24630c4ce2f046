"""netmiko as its examples show it: `ConnectHandler`, `send_command`, `send_config_set`."""

from __future__ import annotations

import json
import sys
from typing import Any

from netmiko import ConnectHandler
from netmiko.exceptions import NetmikoAuthenticationException


def main() -> None:
    """Type the commands of the job and tell what came back."""
    job = json.loads(sys.argv[1])
    print(json.dumps(globals()[job["do"]](job)))


def _open(job: dict[str, Any]) -> Any:
    return ConnectHandler(
        device_type="mikrotik_routeros",
        host=job["host"],
        port=job["ssh"],
        username=job["user"],
        password=job["password"],
    )


def commands(job: dict[str, Any]) -> Any:
    """One by one, each until the prompt is back."""
    with _open(job) as device:
        return [device.find_prompt(), *(device.send_command(command) for command in job["commands"])]


def tables(job: dict[str, Any]) -> Any:
    """Read by the templates that it brings along."""
    with _open(job) as device:
        return [device.send_command(command, use_textfsm=True) for command in job["commands"]]


def config(job: dict[str, Any]) -> Any:
    """Type a script."""
    with _open(job) as device:
        return device.send_config_set(job["commands"])


def login(job: dict[str, Any]) -> Any:
    """A wrong password."""
    try:
        _open({**job, "password": "guessed"})
    except NetmikoAuthenticationException:
        return "NetmikoAuthenticationException"
    return "accepted"


if __name__ == "__main__":
    main()
