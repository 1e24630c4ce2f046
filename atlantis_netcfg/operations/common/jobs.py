"""Construction of the engine's job for a host: rendered text, endpoint, link, journal."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import Access, LteRouter
from atlantis_netcfg.links.policy import active_link
from atlantis_netcfg.operations import restore
from atlantis_netcfg.operations.common.costs import ways_of
from atlantis_netcfg.operations.common.kinds import ManagedDevice, get_managed_device
from atlantis_netcfg.operations.common.saved_states import saved_run
from atlantis_netcfg.operations.common.session_link import site_link_of, with_timeouts
from atlantis_netcfg.operations.common.terminals import PinRecorder, TriedPin
from atlantis_netcfg.routeros import api, apply, desired, link_use

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.links.policy import LinkRoute
    from atlantis_netcfg.operations.common.request import LinkOrder, Request
    from atlantis_netcfg.routeros._types import Observation

_SSH = 22


def device_job(
    inventory: Inventory, host: Host, request: Request, journal: runs.Recorder, notify: Subscriber
) -> apply.DeviceJob:
    """Build the job of one device; raise RenderError, or NoMatchError for a kind that the engine does not handle."""
    managed_device = get_managed_device(inventory, host)
    access = managed_device.access
    store = runs.Store(request.state, is_rehearsal=request.rehearsed)
    ways = ways_of(inventory, host)
    states = _states(managed_device, request, store, ways)
    link = site_link_of(inventory, host, request.via.get(host.name))
    return apply.DeviceJob(
        name=host.name,
        site=host.site,
        address=str(access.address),
        endpoint=with_timeouts(endpoint_of(host, access, request), link),
        desired_state=next(iter(states.values())),
        fitting=None if "" in states else apply.StateVariants(states, managed_device.unfit),
        link=link,
        events=notify,
        journal=_pin_recorder(host, request, store, journal),
        agreed_hash=None if request.plans is None else request.plans.get(host.name, ""),
        ssh=_console(host, access, request, store.pins),
        run=journal.run if isinstance(journal, runs.Journal) else "",
        allows_unprotected=request.unprotected,
        remove_foreign=request.remove_foreign or request.rehearsed,
        shows=None if request.use is None else partial(_check_use, ways, request.use),
        history=apply.NoHistory() if request.mode.reads_only else _history(host, request, store, journal),
    )


def _history(host: Host, request: Request, store: runs.Store, journal: runs.Recorder) -> apply.History:
    """Return what earlier runs left on the device; `resume` names the interrupted run."""
    current = journal.run if isinstance(journal, runs.Journal) else ""
    return store.history(host.site, host.name, current=current, dead=request.run)


def _states(
    managed_device: ManagedDevice, request: Request, store: runs.Store, ways: Sequence[LinkRoute]
) -> Mapping[str, desired.DesiredState]:
    """Return the desired states by the radio menu that they require; an empty key fits any device."""
    pin_problem = (
        "" if request.rehearsed else TriedPin(store.root, managed_device.host.site, managed_device.host.name).why_not
    )
    return {
        text.radio: replace(_desired_state(managed_device.host, text.text, request, ways), pin_refusal=pin_problem)
        for text in managed_device.texts()
    }


def _pin_recorder(host: Host, request: Request, store: runs.Store, journal: runs.Recorder) -> runs.Recorder:
    """Return a recorder that notes a PIN attempt before the PIN is sent; an emulated SIM is always new."""
    if request.rehearsed or not isinstance(host.device, LteRouter):
        return journal
    return PinRecorder(journal, TriedPin(store.root, host.site, host.name))


def _desired_state(host: Host, text: str, request: Request, ways: Sequence[LinkRoute]) -> desired.DesiredState:
    """Return the desired state: of the inventory, of the state before a run (rollback), or of a confirmed state."""
    desired_state = desired.read(text, source=msg(f"the desired text of {arg(host.name)}"))
    if request.use is not None:
        return _apply_link_order(desired_state, ways, request.use)
    if request.restore is not None:
        saved_state = restore.confirmed_state(request.state, host, request.restore, is_rehearsal=request.rehearsed)
        return link_use.without_use(restore.read_replacement(saved_state, desired_state), desired_state)
    if request.back_to is None:
        return desired_state
    earlier_state = saved_run(request.state, host.site, request.back_to, is_rehearsal=request.rehearsed).before(
        host.name
    )
    if earlier_state is None:
        raise errors.NoMatchError(f"run {arg(request.back_to)} has saved no state of {arg(host.name)}")
    export = desired.from_export(earlier_state.text(), desired_state.menus, source=str(earlier_state.path))
    before = link_use.without_use(export, desired_state)
    return restore.for_any_box(before) if request.rehearsed else before


def _apply_link_order(
    desired_state: desired.DesiredState, ways: Sequence[LinkRoute], order: LinkOrder
) -> desired.DesiredState:
    """Return the desired state with the routes and the scheduled job for a temporary order of links."""
    if order.link is None or order.until is None:
        return link_use.end_use(desired_state)
    use = link_use.LinkUse(order.link, order.until, order.until_uptime_s)
    return link_use.start_use(desired_state, use, order.since_uptime_s, {way.name: way.address for way in ways})


def _check_use(ways: Sequence[LinkRoute], order: LinkOrder, observation: Observation) -> str:
    """Return a message if the link should carry the traffic by now and does not; empty otherwise."""
    if order.link is None or not order.proved:
        return ""
    active = active_link(observation.rows.get(link_use.ROUTES, ()), ways)
    return msg(
        ""
        if active == order.link
        else f"{arg(order.link)} then does not carry the traffic: {arg(active or 'nothing')} does"
    )


def _console(host: Host, access: Access, request: Request, pins: runs.Pins) -> apply.SshEndpoint:
    """Return the SSH endpoint of a device: the template keeps SSH enabled for its administrators."""
    if not request.rehearsed:
        key = access.host_key or pins.host_key(host.name)
        return apply.SshEndpoint(str(access.address), _SSH, access.user, access.password, key)
    target = request.targets[host.name]
    return apply.SshEndpoint(target.host, target.ssh or _SSH, access.user, access.password, target.host_key)


def endpoint_of(host: Host, access: Access, request: Request) -> api.Endpoint:
    """Return the API endpoint, with the certificate pin of the inventory or else the one that a person accepted.

    Raises UsageError for a device that the rehearsal does not emulate.
    """
    pins = runs.Store(request.state, is_rehearsal=request.rehearsed).pins
    address, port, pin = str(access.address), access.port, access.fingerprint or pins.get(host.name)
    if request.rehearsed:
        if host.name not in request.targets:
            raise errors.UsageError(f"{arg(host.name)} is not emulated in this rehearsal")
        target = request.targets[host.name]
        address, port, pin = target.host, target.port, target.pin
    return api.Endpoint(
        address,
        port,
        access.user,
        access.password,
        pin,
        window=pins.window(host.name) or api.READING_WINDOW,
        on_window_shrink=partial(_limit_requests, pins, host.name),
    )


def _limit_requests(pins: runs.Pins, name: str) -> None:
    """Remember to send few requests at once to this device; if that cannot be saved, it is detected again."""
    with suppress(errors.NetcfgError):
        pins.narrow(name, api.WINDOW)
