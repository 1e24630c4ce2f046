"""The VPN's commands as they are typed, over real SSH to a server with systemd: nothing secret is in what they start.

strace tells the arguments and the environment of every process on the operator's laptop, Ansible's and ssh's too.
"""

import json
import os
import subprocess
import sys
from contextlib import ExitStack
from typing import Any

import pytest
import vpn_server_stand
from vpn_desk import over_a_pipe
from vpn_server_stand import NAME, ROOT, Stand, stand  # noqa: F401 - a fixture

from atlantis_netcfg.vpn.pki import key_pem

pytestmark = [pytest.mark.namespace, pytest.mark.campaign]

PASSPHRASE = vpn_server_stand._PASSPHRASE.reveal()


class Laptop:
    """The operator's: what was typed there under strace, and all that was seen of it."""

    def __init__(self, stand: Stand) -> None:  # noqa: F811 - not the fixture
        self.stand = stand
        self.seen = ""
        self.environment = os.environ | {
            "ATLANTIS_STATE": str(stand.folder / "state"),
            "ANSIBLE_HOME": str(stand.folder / "ansible"),
            "ANSIBLE_SSH_CONTROL_PATH_DIR": str(stand.folder / "kept"),
            "ANSIBLE_VAULT_PASSWORD_FILE": str(stand.folder / "vault-password"),
            "ANSIBLE_SSH_EXTRA_ARGS": "-F none",
        }
        (stand.folder / "known-typed").write_text(f"{NAME} {stand.machine.host_key}\n")
        known = f"-o UserKnownHostsFile={stand.folder / 'known-typed'}"
        # No connection is kept: strace would wait for the process that keeps it.
        self.environment["ANSIBLE_SSH_ARGS"] = f"-F none -i {stand.key} -o IdentitiesOnly=yes {known}"

    def type(self, *words: str, code: int = 0) -> dict[str, Any]:
        """Type it; every command gets the passphrase over a pipe if it asks for it."""
        trace = self.stand.folder / "trace"
        strace = ("strace", "-f", "-v", "-s", "1000000", "-e", "trace=execve", "-o", str(trace))
        where = f"inventory={self.stand.inventory}"
        with ExitStack() as stack:
            number = stack.enter_context(over_a_pipe(PASSPHRASE))
            more = [f"--passphrase-fd={number}"] if words[:2] in {("vpn", "onboard"), ("vpn", "revoke")} else []
            typed = (sys.executable, "-m", "atlantis_netcfg", *words, *more, where, "--json")
            done = subprocess.run(
                [*self.stand.ground.prefix(), *strace, *typed],
                cwd=ROOT,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                pass_fds=[int(number)],
                check=False,
            )
        assert done.returncode == code, f"{done.stdout[:3000]}\n{done.stderr[-3000:]}"
        told: dict[str, Any] = json.loads(done.stdout)
        self.seen += trace.read_text(errors="replace") + done.stderr
        trace.unlink()
        for row in told.get("members", []):
            if isinstance(row, dict) and row.get("passphrase"):
                self.stand.secrets.add(row["passphrase"])
                assert done.stdout.count(row["passphrase"]) == 1
        return told


def test_no_secret_reaches_a_child_process(stand: Stand) -> None:  # noqa: F811
    stand.laptop("one")
    stand.secrets |= {PASSPHRASE, *key_pem(stand.ca.key).reveal().split("\n")[1:3]}
    laptop = Laptop(stand)
    told = laptop.type("site=scc", f"device={NAME}", "--yes")
    assert told["devices"][NAME]["status"] == "changed"
    (row,) = laptop.type("vpn", "onboard", "partner=iqua", "device=sparus2", "kind=robot")["members"]
    assert row["name"] == "iqua-sparus2"
    status = laptop.type("vpn", "status")
    assert [one["verdict"] for one in status["told"]] == ["PASS", "PASS"]
    assert laptop.type("site=scc", f"device={NAME}", "--yes")["devices"][NAME]["status"] == "unchanged"
    revoked = laptop.type("vpn", "revoke", "name=iqua-sparus2", "--yes")
    assert revoked["evidence"]["confirmed"] is True
    assert laptop.type("vpn", "sync")["changes"] == []
    assert laptop.seen.count("execve(") > 50
    assert '"ssh"' in laptop.seen
    assert [secret for secret in stand.secrets if secret in laptop.seen] == []
