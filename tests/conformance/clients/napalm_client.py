"""napalm-ros as its documentation shows it: getters, `cli`, a merge candidate: compare, commit, confirm, rollback."""

from __future__ import annotations

import json
import ssl
import sys
from contextlib import suppress
from typing import Any

from napalm import get_network_driver

REVERT_AFTER_S = 300


def main() -> None:
    """Do what the job says."""
    job = json.loads(sys.argv[1])
    device = _open(job)
    print(json.dumps(globals()[job["do"]](device, job)))
    device.close()


def _open(job: dict[str, Any]) -> Any:
    context = ssl.create_default_context(cafile=job["ca"])
    context.check_hostname = False
    options = {"port": job["port"], "ssl_wrapper": context.wrap_socket, "ssh_port": job["ssh"]}
    device = get_network_driver("ros")(job["host"], job["user"], job["password"], timeout=30, optional_args=options)
    device.open()
    return device


def getters(device: Any, job: dict[str, Any]) -> Any:
    """What each getter finds."""
    return {name: getattr(device, name)() for name in job["getters"]}


def cli(device: Any, job: dict[str, Any]) -> Any:
    """Commands of the console, by `/execute`."""
    return device.cli(job["commands"])


def merge(device: Any, job: dict[str, Any]) -> Any:
    """Compare a candidate, commit it."""
    device.load_merge_candidate(config=job["text"])
    difference = device.compare_config()
    device.commit_config()
    return {"difference": difference, "pending": device.has_pending_commit()}


def refused(device: Any, job: dict[str, Any]) -> Any:
    """Commit a candidate that does not parse."""
    device.load_merge_candidate(config=job["text"])
    try:
        device.commit_config()
    except Exception as refusal:  # noqa: BLE001 - which one is the answer
        return [type(refusal).__name__, str(refusal)]
    return ["accepted"]


def confirm(device: Any, job: dict[str, Any]) -> Any:
    """Commit with a job on the router that would take it back, and confirm."""
    device.load_merge_candidate(config=job["text"])
    device.commit_config(revert_in=REVERT_AFTER_S)
    told = [device.has_pending_commit()]
    device.confirm_commit()
    return [*told, device.has_pending_commit()]


def rollback(device: Any, job: dict[str, Any]) -> Any:
    """Commit, and take it back: the router loads its backup and reboots, which ends the session."""
    device.load_merge_candidate(config=job["text"])
    device.commit_config()
    with suppress(Exception):
        device.rollback()
    return device.is_alive()


if __name__ == "__main__":
    main()
