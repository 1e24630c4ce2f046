"""Allow-list of read-only programs that the checklist may run on a gateway or on this computer."""

from __future__ import annotations

import re

PROGRAMS: tuple[str, ...] = (
    r"ip -j(son)? (-s )?(-d )?(addr|link|route|neigh|rule)( show)?( (dev|table|to|default|exclude|from)( \S+)?)*",
    r"ip -j route get \d+(\.\d+){3}",
    r"iw dev \S+ (link|info|station dump)",
    r"iw reg get",
    r"ping -n -c \d{1,2} -i \d(\.\d)? -W \d{1,2} (-I \S+ )?\d+(\.\d+){3}",
    r"timedatectl show",
    r"chronyc -n -c (tracking|sources)",
    r"cat /etc/resolv\.conf",
    r"cat /etc/netplan/10-atlantis\.yaml",
    r"cat /etc/network/interfaces",
    r"cat /etc/systemd/network/05-atlantis\.network",
    r"cat /proc/net/udp",
    r"cat /etc/os-release",
    r"cat /proc/device-tree/(model|serial-number)",
    r"cat /sys/class/dmi/id/product_(name|serial)",
    r"cat /sys/class/net/[a-z][a-z0-9]{0,14}/speed",
    r"uname -rm",
    r"ssh-keygen -l -f /etc/ssh/ssh_host_ed25519_key\.pub",
    r"dpkg-query -W -f=\$\{Package\}=\$\{Version\}=\$\{db:Status-Status\}\\n( [a-z0-9][a-z0-9+.-]+)+",
    r"openssl storeutl -noout -text -certs /etc/openvpn/client/atlantis\.identity",
)
"""Patterns for the full command line, joined by blanks; an argument with a blank is rejected earlier."""
_PATTERNS = tuple(re.compile(program) for program in PROGRAMS)


def is_allowed(argv: tuple[str, ...]) -> bool:
    """Return whether a command line is on the allow-list."""
    if any(not argument or re.search(r"\s", argument) for argument in argv):
        return False
    return any(pattern.fullmatch(" ".join(argv)) for pattern in _PATTERNS)


def names() -> tuple[str, ...]:
    """Return the names of the programs, without duplicates, in the order of the list."""
    return tuple(dict.fromkeys(program.split(" ", 1)[0] for program in PROGRAMS))
