"""A partner's robot: a computer in a network namespace with an /etc of its own, and somebody who types at its terminal.

It has real OpenVPN, age, tar and bash. In the place of two programs that a namespace cannot run there are others:
`sudo` only runs what it is given, and `systemctl` starts what Debian's own unit of OpenVPN says, and keeps it no more.
"""

import os
import pty
import re
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

from matrix_stand import Vpn

_ETC = """\
mount -t tmpfs tmpfs /mnt && mkdir /mnt/upper /mnt/work &&
mount -t overlay overlay -o lowerdir=/etc,upperdir=/mnt/upper,workdir=/mnt/work /etc &&
echo ready && exec sleep infinity
"""
_SUDO = '#!/bin/sh\nexec "$@"\n'
_SYSTEMCTL = """\
#!/bin/sh
state=STATE
[ "$1" != --quiet ] || shift
echo "$*" >> "$state/typed"
unit=$2
case $1 in
    daemon-reload) ;;
    enable) touch "$state/enabled" ;;
    is-enabled) [ -e "$state/enabled" ] ;;
    is-active) [ -e "$state/pid" ] && kill -0 "$(cat "$state/pid")" ;;
    start | restart)
        [ ! -e "$state/pid" ] || kill "$(cat "$state/pid")"
        name=${unit#openvpn-client@}
        file=/lib/systemd/system/openvpn-client@.service
        cd "$(sed -n 's/^WorkingDirectory=//p' $file)" || exit 1
        command=$(sed -n "s/^ExecStart=//; T; s/%i/$name/; p" $file)
        setsid $command > "$state/log" 2>&1 < /dev/null &
        echo $! > "$state/pid"
        ;;
    *) exit 64 ;;
esac
"""


@dataclass
class Robot:
    """The computer of a member of the stand, whose own tunnel is taken down."""

    stand: Vpn
    member: str
    folder: Path
    typed: list[str] = field(default_factory=list)
    """Every command, as it was typed."""

    def __post_init__(self) -> None:
        self.stand.openvpn[self.member].kill()
        self.home, self.state, self.programs = (self.folder / name for name in ("home", "state", "bin"))
        for folder in (self.home, self.state, self.programs):
            folder.mkdir(parents=True)
        self.program("sudo", _SUDO)
        self.program("systemctl", _SYSTEMCTL.replace("STATE", str(self.state)))
        self._holder = self.stand.start(self.member, "sh", "-c", _ETC)
        assert self._holder.stdout is not None
        assert self._holder.stdout.readline() == "ready\n"
        self.stand.stack.callback(self._holder.stdout.close)
        self.stand.stack.callback(self.end)

    def program(self, name: str, text: str) -> None:
        """Put a program where it is found first."""
        (self.programs / name).write_text(text)
        (self.programs / name).chmod(0o755)

    def end(self) -> None:
        """End the tunnel."""
        pid = self.state / "pid"
        if pid.exists():
            subprocess.run(["kill", pid.read_text().strip()], check=False)

    def command(self, line: str) -> list[str]:
        """What runs a line in the home folder of this computer."""
        inside = ["nsenter", f"--target={self._holder.pid}", "--mount", "--net", "bash", "-c"]
        return [*inside, f"export PATH={self.programs}:$PATH; cd {self.home} && {line}"]

    def type(self, line: str, answer: str = "") -> tuple[int, str]:
        """Type a line at a terminal, and the answer to a question for a passphrase: exit code and what was seen."""
        self.typed.append(line)
        words = self.command(line)
        child, terminal = pty.fork()
        if child == 0:
            os.execvp(words[0], words)  # noqa: S606 - behind a fork
        seen = b""
        while True:
            try:
                data = os.read(terminal, 65536)
            except OSError:  # a terminal whose last program has ended
                break
            if not data:
                break
            seen += data
            if answer and b"passphrase" in seen:
                os.write(terminal, f"{answer}\n".encode())
                answer = ""
        os.close(terminal)
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), seen.decode().replace("\r\n", "\n")

    def start(self, line: str) -> subprocess.Popen[str]:
        """Type a line whose program goes on until the stand ends."""
        self.typed.append(line)
        process = subprocess.Popen(self.command(line), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.stand.stack.callback(process.wait)
        self.stand.stack.callback(process.kill)
        return process


def three_commands(page: str) -> list[str]:
    """Those that the robot's page tells to type."""
    block = re.search(r"^Three commands\n-+\n\n((?:    .*\n)+)", page, re.MULTILINE)
    assert block is not None
    return [line.strip() for line in block[1].splitlines()]
