"""Runs in a network namespace of its own: makes a LAN of one card, runs the programs, and prints what they printed."""

import json
import socket
import subprocess
import sys

SET_UP = (
    "ip link set lo up",
    "ip link add eth0 address 02:00:5e:00:01:10 type veth peer name far",
    "ip link set far up",
    "ip link set eth0 up",
    "ip addr add 10.64.1.10/24 broadcast + dev eth0",
    "ip addr add 10.64.1.11/24 broadcast + dev eth0 valid_lft 3000 preferred_lft 3000",
    "ip neigh add 10.64.1.1 lladdr 02:00:5e:10:01:01 dev eth0 nud permanent",
    "ip route add default via 10.64.1.1 dev eth0 proto static",
    "ip route add 192.0.2.0/24 via 10.64.1.1 dev eth0 proto static metric 600",
)


def main() -> None:
    for command in SET_UP:
        subprocess.run(command.split(), check=True)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("10.64.1.10", 7410))
        told = []
        for argv in json.load(sys.stdin):
            done = subprocess.run(argv, capture_output=True, text=True, check=False)
            told.append([done.returncode, done.stdout, done.stderr])
    json.dump(told, sys.stdout)


if __name__ == "__main__":
    main()
