"""Whoever answers at a computer's address: a program that stands before OpenSSH's client on PATH.

It speaks as far as it is listened to: as our modules' tool, as the live tool of the VPN's server, or as a shell; and it
puts the text of the environment's `HOSTILE_TEXT` wherever words go. It imports nothing of ours: each call is a process.
"""

import base64
import json
import os
import sys
import zlib
from pathlib import Path
from typing import Any

MANNERS = ("away", "answers", "refuses", "breaks", "lacks")
"""Nobody lets us in; every answer is whole; each is a refusal; our program fails there; answers lack what they need."""
_TOOL, _MARK = "/var/lib/atlantis/tool", "ATLANTIS-RESULT "
_LIVE, _PACKED = "/var/lib/atlantis/live", "ATLANTIS-VPN "


def before_ssh(folder: Path, text: str, manner: str) -> dict[str, str]:
    """Put the program there, and give what changes in the environment."""
    program = folder / "bin" / "ssh"
    program.parent.mkdir(exist_ok=True)
    program.write_text(f'#!/bin/sh\nexec /usr/bin/python3 -I "{__file__}" "$@"\n')
    program.chmod(0o755)
    path = f"{program.parent}:{os.environ['PATH']}"
    return {"PATH": path, "HOSTILE_TEXT": text, "HOSTILE_MANNER": manner}


def main(argv: list[str]) -> None:
    """Be an OpenSSH that has connected, or has not."""
    text, manner, command = os.environ["HOSTILE_TEXT"], os.environ["HOSTILE_MANNER"], argv[-1]
    if "-O" in argv:
        return
    _say(sys.stderr.buffer, f"{text}\r\n")
    if manner == "away":
        sys.exit(255)
    if _LIVE in command:
        _serve(text, manner)
    elif _TOOL in command:
        sys.stdin.buffer.read()
        told = {"failed": manner != "answers", "msg": text, "changed": True, "changes": [text], "notes": [text]}
        more = {"hint": text, "warnings": [text], "deprecations": [{"msg": text}], "exception": text, text: text}
        diff = [{"before": text, "after": f"{text}!", "before_header": text, "after_header": text}]
        found = {"warnings": [text]} if manner == "lacks" else {**told, **more, "diff": diff}
        _say(sys.stdout.buffer, f"{text}\n{_MARK}{json.dumps(found)}\n{text}\n")
    else:
        _say(sys.stdout.buffer, f"{text}\n")
        sys.exit(1)


def _say(stream: Any, text: str) -> None:  # noqa: ANN401
    stream.write(text.encode())
    stream.flush()


def _serve(text: str, manner: str) -> None:
    """Answer as the live tool does (`vpn_serve.py`)."""
    _tell({"id": 0, "done": {}})
    for line in iter(sys.stdin.buffer.readline, b""):
        asked = json.loads(zlib.decompress(base64.b64decode(line)))
        answers: dict[str, dict[str, Any]] = {
            "answers": {"done": _answers(text)},
            "refuses": {"refused": text, "hint": text},
            "breaks": {"broken": text},
            "lacks": {"done": {}},
        }
        _tell({"id": asked["id"], **answers[manner]})


def _tell(told: dict[str, Any]) -> None:
    packed = base64.b64encode(zlib.compress(json.dumps(told).encode())).decode()
    _say(sys.stdout.buffer, f"{os.environ['HOSTILE_TEXT']}\n{_PACKED}{packed}\n")


def _answers(text: str) -> dict[str, Any]:
    """One answer to everything that is asked."""
    session = {"common_name": text, "real": text, "virtual": text, "since": 1.0, "received": 1, "sent": 1}
    looked = {
        "ready": True,
        "files": {f"/etc/openvpn/ccd/{text}": text},
        "list": {"number": 1, "begins": 1.0, "ends": 2.0, "signed": True, "pem": text},
        "members": None,
        "as_file": False,
        "firewall_why": text,
        "redirects": [text],
        "version": text,
        "package": text,
        "unit": {"ActiveState": text, "SubState": text},
        "sessions": [session],
        "management": text,
        "why": text,
        "at": 1.0,
        "seen": {"seen": {text: {"last": 1.0}}},
        "clock": 1.0,
    }
    cut = {"out": False, "dead": False, "left": [text], "told": [text], "steps": [[text, 1.0]]}
    pushed = {"changes": [text], "lacks": [], "ended": [{**session, "replies": [text]}]}
    return {**looked, **cut, **pushed}


if __name__ == "__main__":
    main(sys.argv)
