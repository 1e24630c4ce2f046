"""Commands that only read the inventory: `inventory validate` and `robot dds`.

`provision inventory validate`: check the whole inventory, without contacting a device.

`provision robot dds`: the DDS profiles of a computer, one set for each link of its site.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.computers.dds import ProfileView
    from atlantis_netcfg.inventory import Finding, Inventory, InventoryInvalid
    from atlantis_netcfg.links.standing_traffic import StandingTraffic


VALIDATE = syntax.CommandSpec(
    "inventory validate",
    "check the inventory; list every error with file and line",
    words=(syntax.INVENTORY,),
    flags=(
        syntax.Flag("examples", "list example values still to be replaced, and where they are"),
        syntax.JSON,
    ),
    details="No device is contacted, and no vault password is needed: vaulted secrets are not decrypted.",
)


def run_validate(arguments: syntax.Arguments) -> ExitCode:
    """Run `inventory validate`: print what was checked, or list every error."""
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import InventoryInvalid, load
    from atlantis_netcfg.inventory.robots.reading import load_robots

    inventory = paths.inventory_folder(arguments.optional("inventory"))
    try:
        pilot_inventory = load(inventory)
        sources, _ = load_robots(pilot_inventory)
    except InventoryInvalid as error:
        return _refuse(error, inventory, as_json=arguments.flag("json"))
    warnings = [finding for source in sources for finding in source.warnings]
    return _print_valid(pilot_inventory, sorted((*warnings, *_warnings(pilot_inventory))), arguments)


def _refuse(error: InventoryInvalid, inventory: Path, *, as_json: bool) -> ExitCode:
    import dataclasses
    import sys

    if as_json:
        _print_json_counts(error.exit, inventory, errors=[dataclasses.asdict(finding) for finding in error.findings])
    else:
        print(translate(str(error)), file=sys.stderr)
    return error.exit


def _print_valid(inventory: Inventory, warnings: Sequence[Finding], arguments: syntax.Arguments) -> ExitCode:
    import dataclasses
    from collections import Counter

    kinds = Counter(host.device.kind for host in inventory.hosts.values())
    names_by_kind = {
        "sites": [msg(f"{arg(site)} ({arg(len(inventory.site_hosts(site)))} hosts)") for site in inventory.sites],
        "hosts": [f"{count} {kind}" for kind, count in kinds.items()],
        "vehicles": list(inventory.vehicles),
        "partners": list(inventory.partners),
    }
    counts = {name: len(getattr(inventory, name)) for name in names_by_kind}
    if arguments.flag("json"):
        examples = [dataclasses.asdict(example) for example in inventory.examples]
        warning_rows = [dataclasses.asdict(finding) for finding in warnings]
        more = {"checked": counts, "revision": inventory.revision, "examples": examples, "warnings": warning_rows}
        _print_json_counts(ExitCode.DONE, inventory.root, errors=[], **more)
        return ExitCode.DONE
    print(translate(f"{arg(inventory.root)}: no errors"))
    for name, some in names_by_kind.items():
        print(msg(f"  {arg(counts[name]):>3} {arg(name):<9} {arg(join(', ', some))}").rstrip())
    _tell_warnings(warnings)
    _tell_examples(inventory, arguments)
    return ExitCode.DONE


def _warnings(inventory: Inventory) -> tuple[Finding, ...]:
    """Return warnings about valid but questionable entries.

    The load of links is computed only if the inventory has a budget, or a vehicle's published data.
    """
    result = inventory.warnings
    if any(link.has_standing_budget for site in inventory.sites.values() for link in site.bearers):
        from atlantis_netcfg.operations.common.traffic_budget import inventory_warnings

        result = inventory_warnings(inventory)
    if any(vehicle.telemetry for vehicle in inventory.vehicles.values()):
        from atlantis_netcfg.operations.fit import unfit_vehicles
        from atlantis_netcfg.runs import utc_now

        result = tuple(sorted((*result, *unfit_vehicles(inventory, utc_now()))))
    return result


def _tell_warnings(warnings: Sequence[Finding]) -> None:
    from atlantis_netcfg.inventory import report

    if warnings:
        print(translate(report(warnings, warnings=True)))


def _tell_examples(inventory: Inventory, arguments: syntax.Arguments) -> None:
    from atlantis_netcfg.cli.base.output import as_typed, carried_words
    from atlantis_netcfg.core.language import translate
    from atlantis_netcfg.inventory.examples import by_line

    examples, lists_all = inventory.examples, arguments.flag("examples")
    words = carried_words(arguments)
    for line in by_line(examples) if lists_all else ():
        print(f"  {line}")
    if inventory.pilot.example_values and examples:
        rehearsal = f"`provision site={next(iter(inventory.sites))} --rehearse`"
        print(as_typed(translate(f"Still contains example values: for rehearsals only ({arg(rehearsal)})."), words))
        if lists_all:
            print(translate(f"{arg(len(examples))} values are examples."))
        else:
            listing = translate(
                f"{arg(len(examples))} values are examples: `provision inventory validate --examples` lists them."
            )
            print(as_typed(listing, words))
    elif inventory.pilot.example_values:
        print(translate("No example values are left, but `example_values: true` is still set: real runs are refused."))
        print(translate("Set `example_values: false` in group_vars/all/pilot.yml when every value is yours."))
    elif lists_all:
        print(translate("No example values are left."))


def _print_json_counts(code: ExitCode, inventory: Path, **more: object) -> None:
    print(json_text({"exit": int(code), "inventory": str(inventory), **more}))


DDS = syntax.CommandSpec(
    "robot dds",
    "generate the DDS profiles of a computer, one set per link",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("device", "the computer", is_required=True, example="coastal-gateway"),
        syntax.Word("to", "output folder, with one subfolder for each link", example="profiles"),
        syntax.Word(
            "distribution",
            "another ROS 2 release; pypi: `pip install cyclonedds`",
            choices=("foxy", "humble", "jazzy", "pypi"),
        ),
        syntax.INVENTORY,
    ),
    flags=(syntax.Flag("show", "print the files"), syntax.JSON),
    details=(
        "No device is contacted: the files go to /etc/atlantis/dds of the computer. Participants find each other by "
        "the addresses in the inventory, without multicast, and survive a satellite outage of 70 s."
    ),
)


def run_dds(arguments: syntax.Arguments) -> ExitCode:
    """Run `robot dds`: generate the files, write or print them, and describe them."""
    from pathlib import Path

    from atlantis_netcfg.computers.dds import profile_views, profiles
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import choose, load
    from atlantis_netcfg.links.standing_traffic import TrafficSource
    from atlantis_netcfg.operations.common.traffic_budget import standing_traffic

    inventory = load(paths.inventory_folder(arguments.optional("inventory")))
    (host,) = choose(inventory, arguments.word("site"), (arguments.word("device"),))
    views = profile_views(inventory, host, arguments.optional("distribution"))
    files = {name: text for view in views for name, text in profiles(view).items()}
    folder = arguments.optional("to")
    changes = _write(Path(folder), files) if folder is not None else {}
    costs = {traffic.link.name: traffic.only(TrafficSource.DDS) for traffic in standing_traffic(inventory, host.site)}
    if arguments.flag("json"):
        _print_json_profiles(views, costs, files if arguments.flag("show") else dict.fromkeys(files), changes)
    else:
        _print(inventory, views, costs, changes)
        if arguments.flag("show"):
            _show(files)
    return ExitCode.DONE


def _write(folder: Path, files: Mapping[str, str]) -> dict[str, bool]:
    """Write each file atomically, and return whether it changed. Raises UsageError."""
    from atlantis_netcfg.core.atomic_files import write_atomically
    from atlantis_netcfg.core.errors import UsageError

    changes = {}
    for name, text in files.items():
        path = folder / name
        try:
            changes[name] = not path.is_file() or path.read_bytes() != text.encode()
            if changes[name]:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_atomically(path, text.encode(), mode=None)
        except OSError as error:
            reason = error.strerror or str(error)
            raise UsageError(
                f"cannot write {arg(path)}: {arg(reason)}", hint="give another folder with `to=`"
            ) from error
    return changes


def _print(
    inventory: Inventory,
    views: Sequence[ProfileView],
    costs: Mapping[str, StandingTraffic],
    changes: Mapping[str, bool],
) -> None:
    from atlantis_netcfg.links.cost import size

    first, release = views[0], views[0].release
    brings = f"Cyclone DDS {release.cyclone.version}"
    brings += msg(f" and Fast DDS {arg(release.fast_dds)}" if release.fast_dds is not None else "")
    print(
        translate(
            f"{arg(first.host)}: {arg(release.name)} with {arg(brings)}, domain {arg(first.domain)}, at "
            f"{arg(first.address)}"
        )
    )
    print(
        translate(
            f"  peers, without multicast: {arg(join(', ', (f'{name} {address}' for name, address in first.peers)))}"
        )
    )
    print(
        translate(
            f"  removed after {arg(first.lease_s)} s of silence; up to {arg(first.participants)} processes of a "
            "computer are discovered"
        )
    )
    for view in views:
        print(
            translate(
                f"  {arg(view.link):<10} announced every {arg(view.tuning.announce_s):>2} s (estimate: "
                f"{arg(view.announced_mb_a_day):.0f} MB a day for each process), datagrams of up to "
                f"{arg(view.tuning.message_bytes)} bytes"
            )
        )
    print(
        translate(
            f"  total DDS traffic of {arg(inventory.hosts[first.host].site)}, with {arg(first.processes)} running on a "
            "computer:"
        )
    )
    for name, traffic in costs.items():
        price = msg(f", {arg(traffic.bill.money)}" if traffic.link.is_metered else "")
        month = size(traffic.month_bytes)
        print(
            translate(
                f"  {arg(name):<10} {arg(month)} a month in both directions while it carries the traffic{arg(price)}"
            )
        )
    for name, has_changed in changes.items():
        print(translate(f"  {'written  ' if has_changed else 'unchanged'}  {arg(name)}"))
    if inventory.pilot.example_values:
        print(translate("The inventory still contains example values."))


def _show(files: Mapping[str, str]) -> None:
    for name, text in files.items():
        print(msg(f"\n--- {arg(name)}\n{arg(text.rstrip())}"))


def _print_json_profiles(
    views: Sequence[ProfileView],
    costs: Mapping[str, StandingTraffic],
    files: Mapping[str, str | None],
    changes: Mapping[str, bool],
) -> None:

    first = views[0]
    links = [
        {
            "link": view.link,
            "announce_s": view.tuning.announce_s,
            "message_bytes": view.tuning.message_bytes,
            "announced_mb_a_day": round(view.announced_mb_a_day, 1),
            "standing": costs[view.link].as_dict(),
        }
        for view in views
    ]
    document = {
        "exit": int(ExitCode.DONE),
        "errors": [],
        "host": first.host,
        "distribution": first.release.name,
        "domain": first.domain,
        "address": first.address,
        "peers": dict(first.peers),
        "lease_s": first.lease_s,
        "links": links,
        "files": [{"name": name, "text": text, "changed": changes.get(name)} for name, text in files.items()],
    }
    print(json_text(document))
