"""The gateway suite of `checks/`, run as a technician runs it, against a machine."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from gateway_role import NAME, ROOT

if TYPE_CHECKING:
    from gateway_role import Stand


def checked(stand: Stand, *words: str, user: str = "root") -> dict[str, str]:
    """Name and words of each check that did not pass; `words` are for pytest."""
    config, report = stand.folder / "ssh_config", stand.folder / "report.xml"
    config.write_text(
        f"Host {NAME}\n HostName 127.0.0.1\n Port {stand.gateway.port}\n User {user}\n"
        f" IdentityFile {stand.key.file}\n IdentitiesOnly yes\n UserKnownHostsFile {stand.known}\n"
    )
    command = [sys.executable, "-m", "pytest", "checks/test_gateways.py", "--site", "coastal", f"--ssh-config={config}"]
    command += ["--inventory", str(stand.inventory), "-p", "no:cacheprovider", f"--junitxml={report}", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert report.exists(), done.stdout + done.stderr
    cases = list(ET.parse(report).getroot().iter("testcase"))  # noqa: S314 - our own file
    assert cases, done.stdout
    return {
        case.attrib["name"]: found.attrib.get("message", "") + (found.text or "")
        for case in cases
        for found in (*case.iter("failure"), *case.iter("error"))
    }
