"""`provision`, typed in a shell: give the words to the prepared process of preforked.py, and end as its child ends.

It takes the descriptor of that process as its first argument, and imports nothing of ours: it is started for each line.
"""

import json
import os
import signal
import socket
import sys


def main() -> int:
    """Send the words, environment, folder and open descriptors of this process; return the exit code of the child."""
    server = int(sys.argv[1])
    listed = [int(name) for name in os.listdir("/proc/self/fd")]  # noqa: PTH208 - pathlib would double the start
    passed = [number for number in listed if number not in (0, 1, 2, server) and _is_open(number)]
    request = {
        "module": "atlantis_netcfg.cli",
        "arguments": sys.argv[2:],
        "env": dict(os.environ),
        "passed": passed,
        "folder": os.getcwd(),  # noqa: PTH109 - as above
    }
    ours, answer = socket.socketpair()
    words = os.memfd_create("request")
    os.write(words, json.dumps(request).encode())
    spaces = [os.open(f"/proc/self/ns/{name}", os.O_RDONLY) for name in ("net", "mnt")]
    with socket.socket(fileno=server) as control:
        socket.send_fds(control, [b"!"], [answer.fileno(), words, *spaces, 0, 1, 2, *passed])
    answer.close()
    code = int(ours.recv(16) or 1)
    if code < 0:
        if code != -signal.SIGKILL:
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    return code


def _is_open(number: int) -> bool:
    """Leave out the descriptor of the listing itself."""
    return os.path.exists(f"/proc/self/fd/{number}")  # noqa: PTH110 - as above


if __name__ == "__main__":
    sys.exit(main())
