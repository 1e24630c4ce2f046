"""A laptop that dies: adopts the router of a test, and kills itself at the n-th command that changes something.

Its arguments: what the twin says about itself as JSON, the state folder, `via`, n, and `before` or `after`.
"""

import json
import os
import signal
import sys
from pathlib import Path

from carton import CHANGES, ROUTER, declaration

from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.operations.adopt import Adoption
from atlantis_netcfg.routeros.console.terminal import Terminal

RUN = Terminal.run


def die_at(number: int, when: str) -> None:
    """Let the n-th change be the last thing that this process does."""
    left = [number]

    def run(terminal: Terminal, command: str, **options: object) -> str:
        change = CHANGES.search(command) is not None and not command.startswith(":put")
        here, left[0] = change and left[0] == 0, left[0] - change
        if here and when == "before":
            os.kill(os.getpid(), signal.SIGKILL)
        said = RUN(terminal, command, **options)  # type: ignore[arg-type]
        if here:
            os.kill(os.getpid(), signal.SIGKILL)
        return said

    Terminal.run = run  # type: ignore[method-assign, assignment]


def main() -> None:
    info, state, via, number, when = json.loads(sys.argv[1]), *sys.argv[2:]

    def locate(address: str, port: int) -> tuple[str, int]:
        doors = info if address == "10.64.100.1" else info["first_contact"]
        return info["host"], int(doors["ports"].get(str(port), 1))

    die_at(int(number), when)
    declared = declaration()
    adoption = Adoption(
        declared,
        declared.hosts[ROUTER],
        Path(state),
        "provision device adopt",
        ignore,
        lambda: iter([Secret("")]),
        via=via,
        is_rehearsal=True,
        locate=locate,
    )
    adoption.carry_out(lambda _: None)


if __name__ == "__main__":
    main()
