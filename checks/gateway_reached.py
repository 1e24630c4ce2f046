"""The one connection to a gateway: testinfra over OpenSSH, all questions in one command, the answers kept."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import testinfra

from atlantis_netcfg.errors import UsageError
from atlantis_netcfg.operations.computers.parts import ACCESS, PARTS
from atlantis_netcfg.operations.examples import refuse_examples
from atlantis_netcfg.operations.request import Request

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.site import Declaration
    from checks.gateway_promises import Promises

__all__ = ["Answers", "NotReached", "ask"]

_PROBE = Path(__file__).with_name("gateway_probe.py")
_OPTIONS = (
    "BatchMode=yes",
    "Compression=yes",
    # A key that is not pinned is refused, and one that has changed: `provision` pins it at first contact.
    "StrictHostKeyChecking=yes",
    # As long as a satellite may be silent, and longer: see ansible.cfg.
    "ServerAliveInterval=20",
    "ServerAliveCountMax=6",
)
_CONNECT_S = 120
_KEYS = ("Host key verification failed", "host key is known", "IDENTIFICATION HAS CHANGED")


class NotReached(Exception):
    """A gateway was not asked, so that nothing is known of it."""


@dataclass(frozen=True, slots=True, repr=False)
class Answers:
    """What a gateway says of itself, as `gateway_probe` tells it."""

    told: Mapping[str, Any]
    between: tuple[float, float]
    """This computer's time before and after, seconds since 1970."""

    def __repr__(self) -> str:
        """Short: pytest prints it with every failure."""
        return "what the gateway says"

    def said(self, name: str) -> str:
        """What a program printed; NotReached where it could not be asked."""
        words = self.told["said"][name]
        assert words is not None, f"`{name}` cannot be asked on this computer: its program is missing, or it failed"
        return str(words)


def ask(declaration: Declaration, promised: Promises, ssh_config: str | None) -> Answers:
    """Ask everything, in one round trip after those of SSH. Raises NotReached.

    `ssh_config`: a file of OpenSSH that says how the host's name is reached, in place of the declared address.
    """
    name = promised.host.name
    try:
        refuse_examples(declaration, rehearsed=ssh_config is not None)
    except UsageError as error:
        raise NotReached(f"{error}; {error.hint}") from None
    access = PARTS[ACCESS](declaration, promised.host, Request())
    options = [*_OPTIONS, f"HostKeyAlias={name}"]
    spec = f"ssh://{name}" if ssh_config else f"ssh://{access['user']}@{access['host']}:{access['port']}"
    host = testinfra.get_host(
        spec,
        ssh_config=ssh_config,
        ssh_extra_args=" ".join(f"-o {option}" for option in options),
        timeout=_CONNECT_S,
        controlpersist=0,
        sudo=bool(access["become"]),
    )
    began = time.time()
    try:
        done = host.run("python3 -c %s %s", _PROBE.read_text(encoding="utf-8"), json.dumps(promised.questions()))
    except RuntimeError as error:
        raise NotReached(_words(name, error)) from None
    if done.rc != 0:
        raise NotReached(f"{name} could not answer: {done.stderr.strip()[-600:]}")
    return Answers(json.loads(done.stdout), (began, time.time()))


def _words(name: str, error: RuntimeError) -> str:
    said = str(getattr(error.args[0], "stderr", error)).strip()
    hint = "look at its power and its cable, then type the same again"
    if any(word in said for word in _KEYS):
        hint = f"if it is a new computer or a new card: `ssh-keygen -R {name}`, then let `provision` pin its key"
    return f"{name} was not reached: {said.splitlines()[-1] if said else 'ssh said nothing'}; {hint}"
