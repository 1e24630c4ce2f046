"""What the running server has otherwise than the record says, in words. Pure."""

from __future__ import annotations

import hashlib
from datetime import timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.vpn.server import CCD, FIREWALL, FOLDER, SERVICE

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.gateway.parts import File
    from atlantis_netcfg.operations.vpn._state import Crl, ServerState
    from atlantis_netcfg.vpn.identity import MembershipList

__all__ = ["ALARM", "drift"]

ALARM = timedelta(days=30)
"""So long before its end a list has to be signed anew: after that nobody can connect."""
_CLOCK_S = 60.0
_CRL = f"{FOLDER}/crl.pem"


def drift(state: ServerState, files: Sequence[File], roll: MembershipList) -> tuple[str, ...]:
    """Compare; `wanted` is what `live_files` gives. Nothing: the server is as recorded."""
    if not state.ready:
        return ("no server of the VPN was ever set up there",)
    return (*_admissions(state, files), *_list(state, files, roll), *_firewall(state, files), *_running(state))


def _admissions(state: ServerState, desired: Sequence[File]) -> Iterator[str]:
    files = {file.path: file for file in desired if file.path.startswith(f"{CCD}/")}
    for path, file in files.items():
        name, found = path.rpartition("/")[2], state.files.get(path)
        if found is None:
            yield f"{name} is recorded, and the server does not admit it"
        elif found != _sha256(file):
            yield f"{name}: its file on the server was changed by hand ({path})"
    for path in state.files:
        if path.startswith(f"{CCD}/") and path not in files:
            yield f"{path.rpartition('/')[2]} is not to be admitted, and the server has a file that admits it ({path})"


def _list(state: ServerState, files: Sequence[File], roll: MembershipList) -> Iterator[str]:
    crl = state.crl
    if crl is None:
        yield "the server has no list of revoked certificates that can be read: nobody can connect"
        return
    if not crl.signed:
        yield "the server's list of revoked certificates is of another authority: who was revoked is let in"
    elif crl.number < roll.crl_number:
        yield f"the server's list of revoked certificates is number {crl.number}, and the record's is {roll.crl_number}"
    elif crl.number > roll.crl_number:
        yield (
            f"the server's list of revoked certificates is number {crl.number}, newer than the record's "
            f"({roll.crl_number}): somebody works with another copy of the authority"
        )
    elif any(file.path == _CRL and state.files.get(_CRL) != _sha256(file) for file in files):
        yield f"the server's list of revoked certificates has the record's number {crl.number}, and is another one"
    yield from _end(crl, state)


def _end(crl: Crl, state: ServerState) -> Iterator[str]:
    if crl.begins > state.clock:
        yield f"by the server's clock its list of revoked certificates begins on {crl.begins:%Y-%m-%d %H:%M} UTC only"
    elif crl.ends <= state.clock:
        yield f"the server's list of revoked certificates has expired on {crl.ends:%Y-%m-%d}: nobody can connect"
    elif crl.ends - state.clock < ALARM:
        days = (crl.ends - state.clock).days
        yield (
            f"the server's list of revoked certificates ends in {days} days, on {crl.ends:%Y-%m-%d}: "
            "after that nobody can connect"
        )


def _firewall(state: ServerState, files: Sequence[File]) -> Iterator[str]:
    if any(file.path == FIREWALL and state.files.get(FIREWALL) != _sha256(file) for file in files):
        yield f"the firewall's file is not as recorded ({FIREWALL})"
    if state.firewall_why:
        yield f"the firewall cannot be asked: {state.firewall_why}"
    elif state.members is None:
        yield "the firewall of the VPN is not loaded"
    elif state.firewall_as_file is False:
        yield "the firewall that is loaded is not what its file says: somebody has changed it with nft"
    if state.redirects:
        yield f"the server's kernel may send ICMP redirects, by {', '.join(state.redirects)}: members would go past it"


def _running(state: ServerState) -> Iterator[str]:
    if state.active is False:
        yield f"the server does not run: {SERVICE} is {state.unit['ActiveState']} ({state.unit.get('SubState', '')})"
    elif not state.asked:
        yield f"the server cannot be asked who is connected: {state.why}"
    if abs(state.clock_ahead_s) > _CLOCK_S:
        word = "ahead of" if state.clock_ahead_s > 0 else "behind"
        yield f"the server's clock is {abs(state.clock_ahead_s):.0f} s {word} this computer's"


def _sha256(file: File) -> str:
    return hashlib.sha256(file.content.encode()).hexdigest()
