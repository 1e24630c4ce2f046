"""Network namespaces, the links between them, and sockets that live in one of them."""

from __future__ import annotations

import ctypes
import os
import socket
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from atlantis_netcfg.emulator.lab._programs import program

__all__ = ["BRIDGE", "Inside", "add_namespace", "delete_namespace", "join"]

BRIDGE = "br0"
_CLONE_NEWNET = 0x40000000
_LIBC = ctypes.CDLL(None, use_errno=True)


def add_namespace(name: str) -> None:
    """A namespace with a loopback that is up."""
    program("ip", "netns", "add", name)
    program("ip", "-n", name, "link", "set", "lo", "up")


def delete_namespace(name: str) -> None:
    """Remove it with its links; sockets that are still open in it keep it alive, nameless."""
    if Path("/run/netns", name).exists():
        program("ip", "netns", "delete", name)


def join(lab: str, port: str, machine: str, interface: str, mac: str) -> None:
    """Lay a cable from a machine's interface to a port of the yard's bridge; the port is down."""
    program(
        *("ip", "link", "add", interface, "netns", machine, "address", mac, "type", "veth"),
        *("peer", "name", port, "netns", lab),
    )
    program("ip", "-n", lab, "link", "set", port, "master", BRIDGE)


class Inside:
    """Makes sockets in a network namespace: threads of its own live there, and a socket stays where it was made."""

    def __init__(self, namespace: str) -> None:
        self._pool = ThreadPoolExecutor(4, namespace, initializer=_enter, initargs=(namespace,))

    def socket(self, kind: int = socket.SOCK_STREAM) -> socket.socket:
        """A socket of IPv4, to be used from any thread."""
        return self._pool.submit(socket.socket, socket.AF_INET, kind).result()

    def close(self) -> None:
        self._pool.shutdown()


def _enter(namespace: str) -> None:
    with Path("/run/netns", namespace).open("rb") as door:
        if _LIBC.setns(door.fileno(), _CLONE_NEWNET):
            code = ctypes.get_errno()
            raise OSError(code, os.strerror(code), namespace)
