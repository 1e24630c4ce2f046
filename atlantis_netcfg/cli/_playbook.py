"""Runs `playbooks/site.yml` for a request and listens to the engine's events while it runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.errors import ExitCode, NetcfgError, UsageError
from atlantis_netcfg.events import Event, Stage

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.events import Subscriber
    from atlantis_netcfg.operations import Mode, Request

__all__ = ["Ended", "Outcome", "Told", "play"]


class Told(NetcfgError):
    """An error that the engine has already put into words, with the exit code that it chose."""

    def __init__(self, message: str, hint: str | None, code: int) -> None:
        super().__init__(message, hint=hint)
        self.exit = ExitCode(code)


@dataclass(slots=True)
class Outcome:
    """What the play came to: one entry a device, as the engine wrote it."""

    devices: dict[str, dict[str, Any]] = field(default_factory=dict)
    runs: dict[str, str] = field(default_factory=dict)
    """Site to run id, as `provision runs` lists it."""


Ended = Callable[[str, Mapping[str, Any]], object]
"""Told the name and the result of a device as soon as it has ended."""


def play(  # noqa: PLR0913 - one call, from one place
    checkout: Path,
    inventory: Path,
    limit: Sequence[str],
    request: Request,
    notify: Subscriber,
    *,
    ended: Ended = lambda _name, _result: None,
) -> Outcome:
    """Run the playbook to its end. Raises Told for an error in the engine's words, NetcfgError if Ansible fails."""
    playbook = checkout / "playbooks" / "site.yml"
    if not playbook.is_file():
        raise UsageError(f"there is no {playbook}", hint="run `provision` from a checkout of the toolkit")
    reader, writer = os.pipe()
    with tempfile.TemporaryDirectory(prefix="provision-") as folder, os.fdopen(reader, encoding="utf-8") as events:
        variables = Path(folder) / "request.json"
        asked = request.model_copy(update={"events_fd": writer})
        variables.write_text(json.dumps({"atlantis_request": asked.model_dump(mode="json")}), encoding="utf-8")
        command = _command(playbook, inventory, limit, variables, request.mode)
        with subprocess.Popen(  # noqa: S603 - our own interpreter and playbook
            command,
            env=_environment(checkout),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            pass_fds=(writer,),
            text=True,
            encoding="utf-8",
            errors="replace",
        ) as process:
            os.close(writer)
            outcome = _listen(events, notify, ended)
            said, _ = process.communicate()
    if outcome is None:
        raise NetcfgError(f"Ansible stopped before any device was asked:\n{said.strip()}")
    order = {name: place for place, name in enumerate(limit)}
    outcome.devices = dict(sorted(outcome.devices.items(), key=lambda item: order.get(item[0], len(order))))
    return outcome


def _command(playbook: Path, inventory: Path, limit: Sequence[str], variables: Path, mode: Mode) -> list[str]:
    return [
        *(sys.executable, "-m", "ansible", "playbook"),
        *("--inventory", str(inventory)),
        *("--limit", ",".join(limit)),
        *("--extra-vars", f"@{variables}"),
        *("--skip-tags", "recap"),
        *(("--check", "--diff") if mode.reads_only else ()),
        str(playbook),
    ]


def _environment(checkout: Path) -> dict[str, str]:
    """The person's own environment, with our configuration and nothing printed but problems."""
    return {
        **os.environ,
        "ANSIBLE_CONFIG": str(checkout / "ansible.cfg"),
        "ANSIBLE_STDOUT_CALLBACK": "atlantis.netcfg.events",
        "ANSIBLE_NOCOLOR": "1",
    }


def _listen(lines: Iterator[str], notify: Subscriber, ended: Ended) -> Outcome | None:
    """Pass events on until the engine closes its end; None when it never told an outcome."""
    outcome: Outcome | None = None
    problem: Told | None = None
    for line in lines:
        told = json.loads(line)
        if "event" in told:
            notify(_event(told["event"]))
        elif "error" in told:
            problem = Told(told["error"]["message"], told["error"]["hint"], told["error"]["exit"])
        else:
            outcome = outcome or Outcome()
            outcome.devices.update(told["devices"])
            for name, result in told["devices"].items():
                ended(name, result)
            outcome.runs.update(told["runs"])
    if problem is not None:
        raise problem
    return outcome


def _event(told: dict[str, Any]) -> Event:
    return Event(**{**told, "stage": Stage(told["stage"])})
