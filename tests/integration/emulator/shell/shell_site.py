"""A router twin in a thread of its own, for clients that block."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import paramiko
from waiting import HANG_S

from atlantis_netcfg.emulator.routeros import (
    EmulatorSpec,
    RouterLink,
    RouterSpec,
    RunningSite,
    SiteSpec,
    User,
    WireBehaviour,
)

NAME, PASSWORD = "router", "open sesame"


class Twin:
    """The running twin, and how to talk to it from another thread."""

    def __init__(self, site: RunningSite) -> None:
        self._site = site

    @property
    def info(self) -> dict[str, Any]:
        found: dict[str, Any] = self.do("info")
        return found

    @property
    def port(self) -> int:
        return int(self.info["ssh"])

    def do(self, command: str, **arguments: Any) -> Any:  # noqa: ANN401 (JSON of any shape)
        return self._site.do(NAME, command, **arguments)

    def export(self, **options: Any) -> str:  # noqa: ANN401 (passed on)
        text: str = self.do("export", **options)
        return text

    def rows(self, *words: str) -> list[list[str]]:
        answers: list[list[str]] = self.do("console", words=list(words))
        return [answer for answer in answers if answer[0] == "!re"]


@contextmanager
def twin(
    tmp_path: Path,
    *,
    link: RouterLink | None = None,
    knobs: WireBehaviour | None = None,
    **spec: Any,  # noqa: ANN401
) -> Iterator[Twin]:
    users = (User(name="admin", password=PASSWORD), User(name="guest", password=PASSWORD, group="read"))
    router = RouterSpec.model_validate({"name": NAME, "users": users, **spec})
    wire = EmulatorSpec(router=router, link=link or RouterLink(), knobs=knobs or WireBehaviour(boot_s=0.2))
    with RunningSite(SiteSpec(name="site", emulators=(wire,)), tmp_path) as site:
        yield Twin(site)


class Known(paramiko.MissingHostKeyPolicy):
    """Lets the twin's own key through and no other."""

    def __init__(self, box: Twin) -> None:
        self._wanted = box.info["host_key"]

    def missing_host_key(self, client: paramiko.SSHClient, hostname: str, key: paramiko.PKey) -> None:
        del client, hostname
        assert key.fingerprint == self._wanted


@contextmanager
def paramiko_on(
    box: Twin, user: str = "admin", password: str = PASSWORD, *, key: paramiko.PKey | None = None
) -> Iterator[paramiko.SSHClient]:
    client = paramiko.SSHClient()
    client.set_missing_host_key_policy(Known(box))
    try:
        client.connect(
            "127.0.0.1",
            box.port,
            user,
            None if key else password,
            pkey=key,
            look_for_keys=False,
            allow_agent=False,
            timeout=HANG_S,
            banner_timeout=HANG_S,
        )
        yield client
    finally:
        client.close()


def run(client: paramiko.SSHClient, command: str) -> tuple[str, int]:
    """Output and exit status of one command."""
    stdin, stdout, stderr = client.exec_command(command, timeout=HANG_S)
    text, status = stdout.read().decode(), stdout.channel.recv_exit_status()
    assert stderr.read() == b""
    stdin.close()
    return text, status
