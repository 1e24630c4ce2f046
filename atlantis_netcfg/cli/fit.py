"""`provision measure fit`: whether a vehicle's data fit each link of a site, what to reduce, and the cost."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.cli.robot import ADDRESS
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.core.printable import Row
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.fit import LinkFit, TopicFit, VehicleFit
    from atlantis_netcfg.operations.fit.link_capacity import Capacity
    from atlantis_netcfg.operations.fit.measured_telemetry import MeasuredTelemetry, TelemetryChange

_WRITE = syntax.Flag("write", "write the measured rates into `telemetry:` of the vehicle")

FIT = syntax.CommandSpec(
    "measure fit",
    "check whether a vehicle's data rates fit each link, and the cost",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("vehicle", "the vehicle, with its `telemetry:`", is_required=True, example="sparus"),
        syntax.Word("link", "only this link (default: all links of the site)", example="satellite"),
        syntax.Word(
            "run",
            "a stored measurement (default: the newest of each link)",
            example="satellite-20261126T022248Z",
        ),
        syntax.Word("observed", "listen this long instead of using `telemetry:`", example="30s"),
        ADDRESS,
        syntax.INVENTORY,
    ),
    flags=(_WRITE, syntax.JSON),
    details=(
        "The result is computed from topics, sizes and rates, and from the measured capacity of a link, else "
        "from its rate in the inventory. No device is contacted without `observed=`, which listens as `robot "
        "discover` does, best in the LAN of the site. Exit code 0: it fits every requested link, and each was "
        "measured; 6: it does not fit a link, is not proved, or not all topics were received; 7: the inventory "
        "has no data."
    ),
)
_WIDTH = 80


def run_fit(arguments: syntax.Arguments) -> ExitCode:
    """Run `measure fit`: compute and report."""
    import sys

    from atlantis_netcfg.core import paths, printable
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import load
    from atlantis_netcfg.operations.fit import vehicle_fit
    from atlantis_netcfg.runs import Store, utc_now

    inventory = load(paths.inventory_folder(arguments.optional("inventory")))
    telemetry, change = _listen(arguments, inventory)
    state = paths.state_dir()
    fit = vehicle_fit(
        inventory if telemetry is None else telemetry.of(inventory),
        [Store(state), Store(state, is_rehearsal=True)],
        arguments.word("site"),
        arguments.word("vehicle"),
        utc_now(),
        link=arguments.optional("link"),
        run=arguments.optional("run"),
    )
    wrong = telemetry is not None and telemetry.wrong is not None
    code = ExitCode.CHECKS_FAILED if wrong else fit.exit
    is_written = arguments.flag("write")
    if arguments.flag("json"):
        more = {} if telemetry is None or change is None else _as_json(telemetry, change, is_written=is_written)
        print(json_text({**fit.as_json(), **more, "exit": int(code)}))
    else:
        printable.show(rows(fit), sys.stdout)
        if telemetry is not None and change is not None:
            printable.show(_change_rows(telemetry, change, is_written=is_written), sys.stdout)
    return code


def _listen(
    arguments: syntax.Arguments, inventory: Inventory
) -> tuple[MeasuredTelemetry, TelemetryChange] | tuple[None, None]:
    """Listen if requested, and write the result if requested. Raises UsageError."""
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.operations import robots
    from atlantis_netcfg.operations.fit import measured_telemetry, require_vehicle
    from atlantis_netcfg.runs import utc_now

    span, address = arguments.optional("observed"), arguments.optional("address")
    if span is None:
        if arguments.flag("write") or address is not None:
            word = "--write" if arguments.flag("write") else "address="
            raise UsageError(
                f"`{arg(word)}` applies only to received telemetry", hint="add how long to listen: `observed=30s`"
            )
        return None, None
    site, vehicle = arguments.word("site"), arguments.word("vehicle")
    require_vehicle(inventory, site, vehicle)
    telemetry = measured_telemetry.measure(inventory, site, vehicle, robots.seconds_of(span), address)
    change = measured_telemetry.change(inventory, telemetry, utc_now().date())
    if arguments.flag("write"):
        measured_telemetry.write(inventory, telemetry, change)
    return telemetry, change


def _change_rows(telemetry: MeasuredTelemetry, change: TelemetryChange, *, is_written: bool) -> Iterator[Row]:
    yield ""
    for finding in telemetry.findings:
        yield from _message(f"{finding.verdict.value}: {translate(finding.message)}", 0)
    if telemetry.others:
        yield from _message(
            msg(f"not counted, because not in its configuration: {arg(join(', ', telemetry.others))}"), 0
        )
    if not change.difference:
        yield translate(f"{arg(change.file)} is already up to date")
        return
    yield translate(f"{arg(change.file)} was written:" if is_written else f"{arg(change.file)}, with `--write`:")
    yield from (f"  {line}" for line in change.difference)


def _as_json(telemetry: MeasuredTelemetry, change: TelemetryChange, *, is_written: bool) -> dict[str, object]:
    file = change.file if is_written and change.difference else None
    return {"observed": telemetry.as_dict(), "difference": change.difference, "written": file}


def rows(fit: VehicleFit) -> Iterator[Row]:
    """Yield the lines for a person, at most 80 columns wide unless names are long."""
    count = len(fit.links[0].topics)
    yield translate(f"{arg(fit.vehicle)} at {arg(fit.site)}: {arg(count)} topics by {arg(fit.middleware.value)}")
    centres = msg(
        "a control centre" if fit.subscribers == 1 else f"{arg(fit.subscribers)} control centres, a copy to each"
    )
    yield from _message(
        msg(f"published to {arg(centres)}; bytes and packets for each message, with DDS, VPN and IP headers"), 0
    )
    for link in fit.links:
        yield ""
        yield from _link(link)
    yield ""
    yield from _message("Telemetry of other vehicles and retransmissions are not included.", 0)


def _link(link: LinkFit) -> Iterator[Row]:
    from atlantis_netcfg.core.printable import Style, StyledText

    style = {"PASS": Style.GOOD, "FAIL": Style.BAD}.get(link.verdict.value, Style.WARNING)
    yield (f"{link.link.name}  ", StyledText(f"{link.verdict.value}: {translate(link.word)}", style))
    yield from _message(link.reason)
    yield from _message(_capacity(link.capacity))
    yield (
        f"  {translate('topic'):<20}{'Hz':>6}{translate('up B'):>9}{translate('packets'):>9}"
        f"{translate('down B'):>8}{translate('share'):>8}{translate('takes'):>9}{translate('lost'):>8}"
    )
    for topic in link.topics:
        yield _topic(topic)
    up, down = link.capacity.pace.up_bps, link.capacity.down_bps
    yield from _message(
        msg(
            f"at these rates, including the site's own traffic: {arg(link.up_bps / up):.0%} of the capacity up, "
            f"{arg(link.down_bps / down):.0%} down"
        )
    )
    yield from _cost_rows(link, is_thinned=False)
    if not link.fits:
        yield from _thinning_rows(link)
    for words in link.warnings:
        yield from _message(words)


def _thinning_rows(link: LinkFit) -> Iterator[Row]:
    for topic in link.topics:
        if topic.is_thinned:
            yield from _message(
                msg(f"reduce {arg(topic.topic.topic)}: {arg(topic.topic.rate_hz):g} Hz -> {arg(topic.rate_hz):g} Hz")
            )
    up, down = link.capacity.pace.up_bps, link.capacity.down_bps
    with_it = msg(
        f"{arg(link.thinned_up_bps / up):.0%} of the capacity up, {arg(link.thinned_down_bps / down):.0%} down"
    )
    if link.fits_thinned:
        yield from _message(msg(f"reduced: {arg(with_it)}"))
        yield from _cost_rows(link, is_thinned=True)
    else:
        yield from _message(msg(f"does not fit even at the lowest useful rates: {arg(with_it)}"))
        for topic in link.topics:
            if topic.most_hz < topic.rate_hz:
                yield from _message(msg(f"{arg(topic.topic.topic)} alone would fit up to {arg(topic.most_hz):g} Hz"))


def _cost_rows(link: LinkFit, *, is_thinned: bool) -> Iterator[Row]:
    from atlantis_netcfg.links.cost import size
    from atlantis_netcfg.links.standing_traffic import DAY_S

    for seconds, name in ((3600, "an hour"), (DAY_S, "a day")):
        cost = link.costs(seconds, is_thinned=is_thinned)
        yield from _message(
            msg(f"{arg(name)}: {arg(cost.words if link.link.is_metered else size(cost.payload_bytes))}"), 4
        )


def _capacity(capacity: Capacity) -> str:
    from atlantis_netcfg.operations.fit.link_capacity import USABLE

    rates = msg(f"{arg(capacity.pace.up_bps / 1000):.0f} kbit/s up, {arg(capacity.down_bps / 1000):.0f} down")
    loss = msg("loss unknown" if capacity.loss is None else f"{arg(capacity.loss):.2%} of upstream packets lost")
    return msg(
        f"{arg(capacity.source)}: {arg(rates)}, of which {arg(USABLE):.0%} is usable; "
        f"{arg(capacity.pace.rtt_s * 1000):.0f} ms; {arg(loss)}"
    )


def _topic(topic: TopicFit) -> str:
    cost = topic.cost
    loss_text = "?" if topic.message_loss is None else f"{topic.message_loss:.1%}"
    if topic.topic.reliable:
        loss_text = "again"
    takes = msg(f"{arg(topic.seconds * 1000):.0f} ms" if topic.seconds < 1 else f"{arg(topic.seconds):.1f} s")
    return msg(
        "  "
        f"{arg(topic.topic.topic):<20}{arg(topic.topic.rate_hz):>6g}{arg(cost.bytes_up):>9.0f}{arg(cost.packets_up):>9.3g}{arg(cost.bytes_down):>8.0f}{arg(topic.share):>8.1%}{arg(takes):>9}{arg(loss_text):>8}"
    )


def _message(words: str, indent: int = 2) -> Iterator[str]:
    """Yield the lines of a message, translated as a whole."""
    lines = wrap(translate(words), _WIDTH - indent, subsequent_indent="  ", break_long_words=False)
    yield from (f"{'':<{indent}}{line}" for line in lines)
