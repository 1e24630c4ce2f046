"""netmiko as its examples show it: connect by SSH, send the lines of a script, save nothing (RouterOS has no save)."""

from __future__ import annotations

import json
import sys
from itertools import groupby
from pathlib import Path
from typing import Any

from netmiko import ConnectHandler

_SCREEN = 400
"""A line longer than netmiko's screen of 511 columns, less the prompt, comes back folded: its echo is never found."""


def _typed(device: Any, lines: list[str]) -> str:  # noqa: ANN401 - netmiko's own class, which ships no types
    """Type the lines in their order: those that fit the screen as a set, longer ones without waiting for their echo."""
    text = ""
    for fits, some in groupby(lines, key=lambda line: len(line) < _SCREEN):
        if fits:
            text += str(device.send_config_set(list(some)))
        else:
            text += "".join(str(device.send_command_timing(line, cmd_verify=False)) for line in some)
    return text


def main() -> None:
    """Send the commands of the job, or, when there are none, read the export that a no-op compares."""
    job = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    device = ConnectHandler(
        device_type="mikrotik_routeros",
        host=job["host"],
        port=job["ssh_port"],
        username=job["user"],
        password=job["password"],
        conn_timeout=120,
        auth_timeout=120,
        banner_timeout=120,
        read_timeout_override=120,
    )
    text = _typed(device, job["commands"]) if job["commands"] else str(device.send_command("/export"))
    for line in job["last"]:
        text += str(device.send_command_timing(line))
    device.disconnect()
    failures = [line for line in text.splitlines() if "failure:" in line or "expected" in line or "bad command" in line]
    print(f"{len(text)} characters came back; {len(failures)} lines tell a failure")
    for line in failures[:5]:
        print(line)


if __name__ == "__main__":
    main()
