"""`python -m bench.engine INVENTORY STATE NAME=HOST:PORT:PIN ...`: the play that `provision` runs, led to given ports.

For routers that cannot stand at their declared addresses: without root, or hundreds of them. A cable leads to all of
them. Targets may also be given as `@FILE`, one a line.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base.playbook import PlaybookRunner
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations import Request
from atlantis_netcfg.operations.common.request import Target
from atlantis_netcfg.operations.common.session_link import LAN
from atlantis_netcfg.operations.common.vault import Vault

if TYPE_CHECKING:
    from atlantis_netcfg.core.events import Event


def main() -> int:
    """Converge all targets; the exit code is the worst of theirs. The last line is JSON: seconds in the engine."""
    inventory, state, *given = sys.argv[1:]
    words = [line for word in given for line in (Path(word[1:]).read_text().split() if word[0] == "@" else [word])]
    targets = dict(map(_target, words))
    request = Request(
        state=Path(state),
        rehearsed=True,
        targets=targets,
        via=dict.fromkeys(targets, LAN.name),
        command="make bench",
    )
    moments: list[float] = []

    def seen(_event: Event) -> None:
        moments.append(time.perf_counter())

    vault = Vault()
    runner = PlaybookRunner(load(Path(inventory), decrypt=vault.decrypt), vault)
    outcome = runner.play(list(targets), request, seen)
    for name, result in outcome.devices.items():
        print(f"{name}: {result['message']}")
    print(json.dumps({"engine_s": moments[-1] - moments[0]}))
    return max(int(result["exit"]) for result in outcome.devices.values())


def _target(word: str) -> tuple[str, Target]:
    name, _, place = word.partition("=")
    host, port, pin = place.split(":")
    return name, Target(host=host, port=int(port), pin=pin)


if __name__ == "__main__":
    sys.exit(main())
