"""Start the partners' example robot for a while, and tell no more of it than can be seen from the gateway."""

# ruff: noqa: PTH119, PTH120 - paths are text on the gateways' side, where all modules share it

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .build_words import last_words
from .programs import run
from .refused import Refused
from .tree import Stamps

if TYPE_CHECKING:
    from typing import Callable

    from .programs import Done
    from .tree import Tree

__all__ = ["SmokeTest", "Verdict"]

_STAMP = "connection test"
_STILL_RUNS = 124
"""What timeout(1) ends with when it had to end the program."""
_COMMAND = '. "$1" && cd "$2" && exec timeout --kill-after=5 "$3" "$4" "$5"'


@dataclass(frozen=True)
class Verdict:
    """What there is to be said; `worth`: a person should read it."""

    verdict: str
    words: str
    worth: bool


@dataclass(frozen=True)
class SmokeTest:
    """One start of `program` with `config`, as `user`, in what `environment` and `sourced` say, for `seconds`."""

    program: str
    config: str
    sourced: str
    environment: str
    built: str
    """The marker of the build in use: another build is tried anew."""
    user: str
    interface: str
    """The VPN's: without an address on it nothing can be connected."""
    seconds: int

    def judge(self, tree: Tree, *, check: bool, run: Callable[[list[str]], Done] = run) -> Verdict:
        """INCONCLUSIVE, or SKIP with its reason. Raises Refused where the program fails."""
        name = os.path.basename(self.program)
        stamps, desired = Stamps(tree), self._digests(tree)
        if stamps.holds(_STAMP, desired):
            return Verdict(
                "SKIP", f"{name} has been started with this build and this configuration before", worth=False
            )
        if check:
            return Verdict("SKIP", f"{name} is not started by a plan", worth=False)
        done = run(["ip", "-4", "-oneline", "address", "show", "dev", self.interface])
        if done.code != 0 or " inet " not in done.output:
            words = f"{name} was not started: {self.interface}, the VPN's interface, has no address yet"
            return Verdict("SKIP", words, worth=True)
        for path in (self.program, self.config):
            if tree.find(path) is None:
                raise Refused(f"the build has no {path}", "compare `connection_test:` with the partner's examples")
        done = run(self._command(tree))
        if done.code not in (0, _STILL_RUNS):
            raise Refused(
                f"FAIL: {name} ended with {done.code} after its start:\n{last_words(done.output)}",
                "the server C4i and its interface to ROS have to run at the SCC; the partner who made the example can"
                " read its words",
            )
        stamps.note(_STAMP, desired)
        ran = f"ran for {self.seconds} s" if done.code == _STILL_RUNS else "ran, and ended by itself,"
        seen = "whether TEST_ROBOT is connected at the SCC, only a person there can see"
        return Verdict("INCONCLUSIVE", f"INCONCLUSIVE: {name} {ran} without an error; {seen}", worth=True)

    def _command(self, tree: Tree) -> list[str]:
        command = ["systemd-run", "--quiet", "--collect", "--wait", "--pipe", f"--uid={self.user}"]
        if tree.find(self.environment) is not None:
            command += [f"--property=EnvironmentFile={self.environment}"]
        words = [self.sourced, os.path.dirname(self.program), str(self.seconds), self.program, self.config]
        return [*command, "/bin/sh", "-c", _COMMAND, "sh", *words]

    def _digests(self, tree: Tree) -> dict[str, str]:
        paths = (self.program, self.config, self.environment, self.built)
        return {path: hashlib.sha256(tree.read(path) or b"").hexdigest() for path in paths}
