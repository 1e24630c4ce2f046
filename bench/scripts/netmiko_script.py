"""netmiko as its examples show it: connect by SSH, send the lines of a script, save nothing (RouterOS has no save)."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from netmiko import ConnectHandler


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
    said = device.send_config_set(job["commands"]) if job["commands"] else str(device.send_command("/export"))
    for line in job["last"]:
        said += str(device.send_command_timing(line))
    device.disconnect()
    failures = [line for line in said.splitlines() if "failure:" in line or "expected" in line or "bad command" in line]
    print(f"{len(said)} characters came back; {len(failures)} lines tell a failure")
    for line in failures[:5]:
        print(line)


if __name__ == "__main__":
    main()
