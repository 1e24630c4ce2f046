"""Commands that control running emulators, as JSON: `{"twin": ..., "do": ..., argument: value, ...}`.

The same commands work in this process, in another thread, and in another process.
"""

from __future__ import annotations

import inspect
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.emulator.routeros.answers import Trap
from atlantis_netcfg.emulator.routeros.dataplane.rows import network_state
from atlantis_netcfg.emulator.routeros.dataplane.tunnel_rows import tunnel_settings
from atlantis_netcfg.emulator.routeros.environment import update_surroundings
from atlantis_netcfg.emulator.routeros.modem import update_modem
from atlantis_netcfg.emulator.routeros.network.traffic import carry
from atlantis_netcfg.emulator.routeros.site import EmulatedSite, describe
from atlantis_netcfg.emulator.routeros.wire.link import LinkFault, RouterLink, WireBehaviour

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping

    from atlantis_netcfg.emulator.routeros.router import EmulatedRouter

_AIR = "air"
"""The only command that refers to two emulated routers."""


class ControlError(UsageError, ValueError):
    """A control command that is unknown or invalid."""


async def execute(site: EmulatedSite, emulator: str, do: str, arguments: Mapping[str, Any]) -> Any:  # noqa: ANN401 (JSON of any shape)
    """Execute one control command; the result is JSON-able. Raises ControlError."""
    if emulator not in site.routers:
        raise ControlError(f"no twin is called {emulator!r}", hint=f"there are: {', '.join(site.routers)}")
    if do not in {*COMMANDS, _AIR}:
        raise ControlError(f"twins do not know {do!r}", hint=f"they know: {', '.join(sorted([*COMMANDS, _AIR]))}")
    try:
        if do == _AIR:
            return _air(site, emulator, arguments)
        bound = inspect.signature(COMMANDS[do]).bind(site.routers[emulator], **arguments)
        return await COMMANDS[do](*bound.args, **bound.kwargs)
    except (LookupError, TypeError, ValidationError, Trap) as refused:
        raise ControlError(f"{do}: {refused}") from refused


def _air(site: EmulatedSite, emulator: str, changes: Mapping[str, Any]) -> None:
    """Change the path between both ends of a radio link; omitted values are kept."""
    link = next(
        (
            radio_link
            for radio_link in site.links
            if site.routers[emulator] in {radio_link.near.router, radio_link.far.router}
        ),
        None,
    )
    if link is None:
        raise LookupError(f"{emulator} is at no end of a radio link")
    link.change(type(link.air).model_validate({**link.air.model_dump(), **changes}))


async def _info(router: EmulatedRouter) -> dict[str, Any]:
    return describe(router)


async def _export(router: EmulatedRouter, **options: Any) -> str:  # noqa: ANN401 (passed on to export)
    return router.export(**options)


async def _counters(router: EmulatedRouter) -> dict[str, int]:
    return asdict(router.counters())


async def _connections(router: EmulatedRouter) -> list[dict[str, Any]]:
    return [asdict(tally) for tally in router.connections()]


async def _reset(router: EmulatedRouter) -> None:
    router.reset_counters()


async def _gap(router: EmulatedRouter, seconds: float) -> None:
    router.gap(seconds)


async def _wait(router: EmulatedRouter, seconds: float) -> float:
    return await router.wait(seconds)


async def _silence(router: EmulatedRouter, addresses: list[str]) -> None:
    router.silence(addresses)


async def _modem(router: EmulatedRouter, **changes: Any) -> dict[str, Any]:  # noqa: ANN401 (validated by ModemSpec)
    values = update_modem(router.device.core, changes)
    router.spec = router.device.spec = router.device.core.spec
    return values


async def _around(router: EmulatedRouter, **changes: Any) -> dict[str, Any]:  # noqa: ANN401 (validated by Around)
    values = update_surroundings(router.device.core, changes)
    router.spec = router.device.spec = router.device.core.spec
    return values


async def _attach(router: EmulatedRouter, namespace: str | None) -> list[str]:
    return list(router.attach(namespace))


async def _drop(router: EmulatedRouter) -> None:
    router.drop()


async def _vanish(router: EmulatedRouter) -> None:
    router.vanish()


async def _reboot(router: EmulatedRouter, *, clean: bool = True) -> None:
    router.reboot(clean=clean)


async def _restart(router: EmulatedRouter) -> dict[str, Any]:
    await router.restart()
    return describe(router)


async def _arm(router: EmulatedRouter, fault: dict[str, Any]) -> None:
    router.arm(LinkFault.model_validate(fault))


async def _disarm(router: EmulatedRouter) -> None:
    router.disarm()


async def _link(router: EmulatedRouter, **link: Any) -> None:  # noqa: ANN401 (validated by Link)
    router.set_link(RouterLink.model_validate(link))


async def _knobs(router: EmulatedRouter, **knobs: Any) -> None:  # noqa: ANN401 (validated by Knobs)
    router.set_behaviour(WireBehaviour.model_validate(knobs))


async def _console(router: EmulatedRouter, words: list[str], user: str | None = None) -> list[list[str]]:
    return [[answer.kind, *answer.words] for answer in await router.console(words, user=user)]


async def _recertify(router: EmulatedRouter) -> str | None:
    router.recertify()
    return router.pin


async def _rekey(router: EmulatedRouter) -> str:
    router.rekey()
    return router.host_key


async def _carry(router: EmulatedRouter, **flow: Any) -> dict[str, Any]:  # noqa: ANN401 (a flow and its counts)
    return carry(router.device.core, **flow)


async def _network(router: EmulatedRouter) -> dict[str, Any]:
    return asdict(network_state(router.device.core.topology.with_all_linked()))


async def _tunnel(router: EmulatedRouter, interface: str) -> dict[str, Any] | None:
    settings = tunnel_settings(router.device.core, interface)
    return None if settings is None else asdict(settings)


async def _is_wrapped(router: EmulatedRouter, interface: str) -> bool:
    return router.device.is_wrapped(interface)


COMMANDS: dict[str, Callable[..., Awaitable[Any]]] = {
    "around": _around,
    "attach": _attach,
    "carry": _carry,
    "info": _info,
    "export": _export,
    "counters": _counters,
    "connections": _connections,
    "reset": _reset,
    "gap": _gap,
    "silence": _silence,
    "wait": _wait,
    "modem": _modem,
    "drop": _drop,
    "vanish": _vanish,
    "reboot": _reboot,
    "restart": _restart,
    "arm": _arm,
    "disarm": _disarm,
    "link": _link,
    "knobs": _knobs,
    "console": _console,
    "recertify": _recertify,
    "rekey": _rekey,
    "wrapped": _is_wrapped,
    "network": _network,
    "tunnel": _tunnel,
}
"""Values of `do`; the parameters of the function are the command's arguments."""
