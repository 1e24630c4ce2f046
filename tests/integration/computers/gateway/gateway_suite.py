"""The gateway suite of `checks/`, run as a technician runs it, against a machine."""

import os
from xml.etree import ElementTree as ET

import preforked
from gateway_role import NAME, ROOT, Stand

_QUICKLY = ("-p", "no:cacheprovider", "-p", "no:hypothesispytest", "-p", "no:xdist")
"""Without what a suite of checks has no use for, and which the technician's pytest has not got."""


def checked(stand: Stand, *words: str, user: str = "root") -> dict[str, str]:
    """Name and words of each check that did not pass; `words` are for pytest."""
    config, report = stand.folder / "ssh_config", stand.folder / "report.xml"
    config.write_text(
        f"Host {NAME}\n HostName 127.0.0.1\n Port {stand.gateway.port}\n User {user}\n"
        f" IdentityFile {stand.key.file}\n IdentitiesOnly yes\n UserKnownHostsFile {stand.known}\n"
    )
    typed = ["checks/test_gateways.py", "--site", "coastal", f"--ssh-config={config}", f"--junitxml={report}"]
    typed += ["--inventory", str(stand.inventory), *_QUICKLY, *words]
    done = preforked.run(typed, env=os.environ, module="pytest", folder=ROOT)
    assert report.exists(), done.stdout + done.stderr
    cases = list(ET.parse(report).getroot().iter("testcase"))  # noqa: S314 - our own file
    assert cases, done.stdout
    return {
        case.attrib["name"]: found.attrib.get("message", "") + (found.text or "")
        for case in cases
        for found in (*case.iter("failure"), *case.iter("error"))
    }
