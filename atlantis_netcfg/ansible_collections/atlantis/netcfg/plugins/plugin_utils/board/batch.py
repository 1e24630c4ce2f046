"""Part of the zipapp: runs several modules in one call, in order, until one of them has something to change.

Each is run in check mode first. If it has nothing to change, it is run as requested, so that its result is the same as
that of a separate call. The first one that would change something or fails ends the batch: the caller requests that one
and all later ones separately. A request that is itself in check mode changes nothing, so only a failure ends it.
"""

from __future__ import annotations

import json
import subprocess
import sys
import zlib
from typing import Any

from ansible.module_utils.basic import MARK, tell_result


def main() -> None:
    """Run the requests from standard input; the result holds the results of the first of them."""
    answers: list[dict[str, Any]] = []
    for request in json.loads(zlib.decompress(sys.stdin.buffer.read()).decode()):
        answer = _run(request if request["check"] else {**request, "check": True, "log": False})
        if not request["check"] and answer.get("changed") is False:
            answer = _run(request)
        elif not request["check"]:
            break
        if answer.get("failed", True):
            break
        answers.append(answer)
        if not request["check"] and answer["changed"]:
            break
    tell_result({"answers": answers})


def _run(request: dict[str, Any]) -> dict[str, Any]:
    """Run one module as a separate program; one that prints no result has failed."""
    words = [sys.executable, "-I", sys.argv[0], request["name"]]
    data = zlib.compress(json.dumps(request).encode())
    process = subprocess.run(  # noqa: S603 - this very program
        words, input=data, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False
    )
    lines = process.stdout.decode("utf-8", "replace").split("\n")
    text = next((line[len(MARK) :] for line in reversed(lines) if line.startswith(MARK)), None)
    return {"failed": True} if text is None else {"failed": False, **json.loads(text)}
