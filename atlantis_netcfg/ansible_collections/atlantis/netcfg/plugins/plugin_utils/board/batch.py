"""In the tool beside our modules: runs several of them in one call, in order, until one finds something to do.

Each is run in check mode first. Where that finds nothing to do it is run as it was requested, so that its answer is the
one that a call of its own would have got. The first one that differs or fails ends the batch: the caller asks for that
one and all after it by itself. A request that is itself in check mode changes nothing, so that only a failure ends it.
"""

from __future__ import annotations

import json
import subprocess
import sys
import zlib
from typing import Any

from ansible.module_utils.basic import MARK, tell_result


def main() -> None:
    """Answer the requests on standard input; the result holds the answers to the first of them."""
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
    """Run one module as a program of its own; one that tells no result has failed."""
    words = [sys.executable, "-I", sys.argv[0], request["name"]]
    data = zlib.compress(json.dumps(request).encode())
    process = subprocess.run(  # noqa: S603 - this very program
        words, input=data, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False
    )
    lines = process.stdout.decode("utf-8", "replace").split("\n")
    text = next((line[len(MARK) :] for line in reversed(lines) if line.startswith(MARK)), None)
    return {"failed": True} if text is None else {"failed": False, **json.loads(text)}
