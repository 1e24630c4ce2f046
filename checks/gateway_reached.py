"""The one connection to a gateway: testinfra over OpenSSH, all questions in one command, the answers kept."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist import runner
from atlantis_netcfg.operations.common.request import Request

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Inventory
    from checks.gateway_promises import Promises

__all__ = ["Answers", "NotReached", "ask"]

_PROBE = Path(__file__).with_name("gateway_probe.py")


class NotReached(Exception):
    """A gateway was not asked, so that nothing is known of it."""


@dataclass(frozen=True, slots=True, repr=False)
class Answers:
    """What a gateway says of itself, as `gateway_probe` tells it."""

    values: Mapping[str, Any]
    between: tuple[float, float]
    """This computer's time before and after, seconds since 1970."""

    def __repr__(self) -> str:
        """Short: pytest prints it with every failure."""
        return "what the gateway says"

    def output_of(self, name: str) -> str:
        """What a program printed; NotReached where it could not be asked."""
        words = self.values["said"][name]
        assert words is not None, f"`{name}` cannot be asked on this computer: its program is missing, or it failed"
        return str(words)


def ask(declaration: Inventory, promised: Promises, ssh_config: str | None) -> Answers:
    """Ask everything, in one round trip after those of SSH. Raises NotReached.

    `ssh_config`: a file of OpenSSH that says how the host's name is reached, in place of the declared address.
    """
    name = promised.host.name
    try:
        way = runner.way_in(declaration, promised.host, Request(), ssh_config)
        began = time.time()
        done = way.run("python3 -c %s %s", _PROBE.read_text(encoding="utf-8"), json.dumps(promised.questions()))
    except runner.GatewayUnreachable as why:
        raise NotReached(f"{why}; {why.hint}") from None
    if done.rc != 0:
        raise NotReached(f"{name} could not answer: {done.err.decode(errors='replace').strip()[-600:]}")
    return Answers(json.loads(done.out), (began, time.time()))
