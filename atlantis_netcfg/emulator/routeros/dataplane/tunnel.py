"""The tunnels of a router's namespace: a real OpenVPN client for each VPN client that its rows enable.

A client runs in the namespace on the device that exists there, with the keys of the router. Its process ends with its
namespace, which the keeper of the lab removes when the rehearsal ends in whatever way.
"""

from __future__ import annotations

import json
import shlex
import shutil
import subprocess
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from pydantic import TypeAdapter

from atlantis_netcfg.core import errors, paths
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.routeros.dataplane.tunnel_rows import TunnelSettings

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_SETTINGS: Final = TypeAdapter(TunnelSettings | None)
_UP: Final = "Initialization Sequence Completed"
_DOWN: Final = ("process restarting", "process exiting")
_REASONS: Final = ("VERIFY ERROR", "VERIFY SCRIPT ERROR", "AUTH: Received", "TLS key negotiation failed", "Cannot ")
"""Words of OpenVPN's lines that say why an attempt fails; the first of an attempt is the cause of the others."""
_END_S: Final = 5.0
_NAME_CHECK: Final = """\
#!/bin/sh
[ "$1" != 0 ] || openssl x509 -noout -{option} {name} -in "$peer_cert" | grep -q "does match"
"""
"""As RouterOS compares: with the alternative names, which OpenVPN's own `verify-x509-name` leaves out."""


def why_not() -> str | None:
    """Return why no tunnel can be made here, in a few words, or None."""
    packages = [name for name in ("openvpn", "openssl") if shutil.which(name) is None]
    return msg(f"missing: apt install {arg(' '.join(packages))}") if packages else None


class RouterTunnel:
    """A VPN client in a namespace, on the tun device `interface`; it connects again by itself until `close`.

    `show` is called by another thread: with address and prefix length once it is up, and with None when it is down.
    """

    def __init__(
        self,
        namespace: str,
        interface: str,
        settings: TunnelSettings,
        folder: Path,
        show: Callable[[str | None], None] = lambda _address: None,
    ) -> None:
        self.settings = settings
        self.address: str | None = None
        self.failure: str | None = None
        """Why the last attempt has failed, in OpenVPN's words."""
        self._namespace, self._interface, self._show = namespace, interface, show
        self._up = threading.Event()
        configuration = folder / f"{interface}.conf"
        paths.write_private(configuration, _configuration(interface, settings, folder).encode())
        self._process = subprocess.Popen(  # noqa: S603 - a program of the system, and words that are ours
            ("ip", "netns", "exec", namespace, "openvpn", "--config", str(configuration)),  # noqa: S607 - as above
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._follow, name=f"vpn-{namespace}", daemon=True)
        self._reader.start()

    def wait(self, timeout_s: float) -> str | None:
        """Wait until the tunnel is up; return its address with prefix length, or None after the timeout."""
        self._up.wait(timeout_s)
        return self.address

    def close(self) -> None:
        """Stop the client; its address is gone then."""
        self._process.terminate()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        hosts.output_of(("ip", "-n", self._namespace, "address", "flush", "dev", self._interface))

    def _follow(self) -> None:
        is_explained = False
        assert self._process.stdout is not None  # noqa: S101 - it is a pipe
        with self._process.stdout as lines:
            for line in lines:
                if _UP in line:
                    self._change(self._read_address())
                elif any(words in line for words in _DOWN):
                    self._change(None)
                    is_explained = False
                elif not is_explained and any(words in line for words in _REASONS):
                    self.failure, is_explained = line.strip(), True
        self._change(None)

    def _change(self, address: str | None) -> None:
        if address == self.address:
            return
        self.address = address
        if address is None:
            self._up.clear()
        else:
            self.failure = None
        self._show(address)
        if address is not None:
            self._up.set()

    def _read_address(self) -> str | None:
        words = ("ip", "-n", self._namespace, "-j", "-4", "address", "show", "dev", self._interface)
        infos = [info for link in json.loads(hosts.program(*words)) for info in link.get("addr_info", ())]
        return next((f"{info['local']}/{info['prefixlen']}" for info in infos), None)


def _configuration(interface: str, settings: TunnelSettings, folder: Path) -> str:
    """Return the client's configuration; how long it waits for the server comes from the server, as on RouterOS."""
    wrap = "tls-crypt-v2" if "tls-crypt-v2" in (settings.wrap or "") else "tls-crypt"
    blocks = {
        "ca": settings.authorities,
        "cert": settings.identity[settings.identity.index("-----BEGIN CERTIFICATE") :],
        "key": settings.identity,
        **({wrap: settings.wrap} if settings.wrap is not None else {}),
        "auth-user-pass": f"{settings.user}\n{settings.password or '-'}",
    }
    lines = [
        f"client\ndev {interface}\ndev-type tun\nnobind\nverb 3\nsuppress-timestamps",
        f"proto {'udp4' if settings.protocol == 'udp' else 'tcp4-client'}",
        f"remote {settings.address} {settings.port}",
        "connect-retry 2 10\nauth-retry nointeract\nhand-window 30\nauth-nocache",
        "ignore-unknown-option disable-dco\ndisable-dco",
        f"data-ciphers {settings.cipher}\nauth {settings.auth}\ntun-mtu {settings.max_mtu}",
        *(["tls-version-min 1.2", "tls-version-max 1.2"] if settings.tls_version == "only-1.2" else []),
        *([] if settings.has_pulled_routes else ["route-nopull"]),
        *(["explicit-exit-notify 1"] if settings.notifies else []),
        *(_server_check(settings.connect_to, folder / f"{interface}.check") if settings.is_server_verified else ()),
        *(f"<{name}>\n{text.strip()}\n</{name}>" for name, text in blocks.items()),
    ]
    return "".join(f"{line}\n" for line in lines)


def _server_check(name: str, script: Path) -> list[str]:
    option = "checkip" if name.replace(".", "").isdecimal() else "checkhost"
    paths.write_private(script, _NAME_CHECK.format(option=option, name=shlex.quote(name)).encode())
    return [
        "remote-cert-tls server\nscript-security 2",
        f"tls-export-cert {script.parent}",
        f'tls-verify "/bin/sh {script}"',
    ]


class RouterTunnels:
    """All tunnels of one router: they follow its rows, and the emulator shows which are up.

    `do` sends the emulator a control command (`do` of a running site, for this router), which is attached to the
    namespace.
    """

    def __init__(self, do: Callable[..., Any], namespace: str, folder: Path) -> None:
        self.tunnels: dict[str, RouterTunnel] = {}
        """By device."""
        self._do, self._namespace, self._folder = do, namespace, folder
        self._addresses: dict[str, str] = {}
        self._lock = threading.Lock()

    def refresh(self) -> None:
        """Start and stop clients, so that they are as the rows say now."""
        state = self._do("network")
        devices = [device for device in state["tunnels"] if device in state["up"]]
        current = {device: _SETTINGS.validate_python(self._do("tunnel", interface=device)) for device in devices}
        for device, tunnel in list(self.tunnels.items()):
            if tunnel.settings != current.get(device):
                tunnel.close()
                del self.tunnels[device]
        for device, settings in current.items():
            if settings is not None and device not in self.tunnels:
                self.tunnels[device] = RouterTunnel(
                    self._namespace, device, settings, self._folder, self._shower(settings.name)
                )

    def close(self) -> None:
        """Stop all clients."""
        while self.tunnels:
            self.tunnels.popitem()[1].close()

    def _shower(self, name: str) -> Callable[[str | None], None]:
        def show(address: str | None) -> None:
            with self._lock:
                self._addresses.pop(name, None)
                if address is not None:
                    self._addresses[name] = address
                with suppress(errors.NetcfgError):  # the emulator may end before its tunnels
                    self._do("around", tunnels=dict(self._addresses))

        return show
