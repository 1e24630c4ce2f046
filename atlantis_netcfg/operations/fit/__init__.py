"""Whether a vehicle's telemetry fits a link: bytes and packets each way, rates to lower, cost.

A topic may use what remains of `USABLE` of a link's capacity, which is the largest share that may be used before
messages queue (facts: capacity). Besides the vehicle, the link carries the site's standing traffic
(`operations.common.traffic_budget`), without the telemetry of other vehicles: those that work at the same time have to
be added.

If it does not fit, the rates of the least important topics are lowered first: point clouds, then images, then numbers,
in the order in which the queue of a thin link sends them. No rate falls below what is useful.

A capacity is measured if the newest real run of `provision measure link` has a goodput; otherwise the inventory's value
is used, and nothing is proved. Pure except for reading saved runs.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg import inventory
from atlantis_netcfg.computers.dds_link import links_without_dds
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.inventory.rules.vehicles import beside_guideline
from atlantis_netcfg.links import standing_traffic
from atlantis_netcfg.links.cost import bill
from atlantis_netcfg.operations.common import traffic_budget
from atlantis_netcfg.operations.common.site_links import link_named, links_of
from atlantis_netcfg.operations.fit import link_capacity

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import datetime

    from atlantis_netcfg.links.cost import Bill, MeteredLink
    from atlantis_netcfg.links.qualify.archive import SavedRun
    from atlantis_netcfg.runs import Store

LOSSY: Final = 0.1
"""Share of lost messages of a topic from which the loss is a warning."""
LONG_S: Final = 1.0
"""A message that takes longer to leave the site delays all others, and a queue on the route may drop its end."""
_HOUR_S: Final = 3600
_THINNED_FIRST: Final = (model.TelemetryData.POINT_CLOUDS, model.TelemetryData.IMAGES, model.TelemetryData.NUMBERS)
_STEPS: Final = 40
"""Number of interval halvings: the rates are rounded far more coarsely."""


@dataclass(frozen=True, slots=True)
class TopicFit:
    """One topic on one link, for all subscribers together."""

    topic: model.TelemetryTopic
    rate_hz: float
    """Rate at which it fits together with the other topics; the declared rate if no thinning is needed."""
    cost: standing_traffic.MessageCost
    """Cost of one message at the declared rate, to one subscriber."""
    up_bps: float
    """Traffic from the site at the declared rate."""
    down_bps: float
    share: float
    """Share of the capacity from the site at the declared rate."""
    seconds: float
    """Time that one message for all subscribers takes to leave the site; later packets wait as long."""
    most_hz: float
    """Highest rate at which the topic alone would fit: USABLE of the capacity, divided by the bits of a message."""
    message_loss: float | None
    """Share of messages with a lost part, 1 - (1 - p)^n; None: p is not known. Reliable messages are resent."""

    @property
    def is_thinned(self) -> bool:
        """Whether the topic's rate has to be lowered."""
        return self.rate_hz < self.topic.rate_hz

    def warnings(self) -> Iterator[str]:
        """Yield problems of the topic other than the capacity, as text."""
        yield from self.guidelines()
        name = self.topic.topic
        if not self.topic.reliable and self.message_loss is not None and self.message_loss > LOSSY:
            yield msg(
                f"of {arg(name)}, {arg(self.message_loss):.0%} of the messages would be incomplete: make them smaller"
            )
        if self.topic.reliable and self.cost.packets_up > 2 * self.cost.fragments:
            packets, once = round(self.cost.packets_up), self.cost.fragments
            yield msg(
                f"a reliable message of {arg(name)} takes {arg(packets)} packets; with best effort it takes {arg(once)}"
            )
        if self.seconds > LONG_S:
            yield msg(
                f"a message of {arg(name)} takes {arg(self.seconds):.1f} s to leave the site and delays those behind it"
            )

    def guidelines(self) -> Iterator[str]:
        """Yield the report's guidelines that the topic's rate, original or lowered, violates."""
        topic, data = self.topic.topic, self.topic.data
        for rate_hz in dict.fromkeys((self.topic.rate_hz, self.rate_hz)):
            deviation = beside_guideline(data, rate_hz)
            if deviation is not None and deviation[0] == "above":
                yield msg(f"{arg(topic)} at {arg(rate_hz):g} Hz is above the report's guideline ({arg(deviation[1])})")
            elif deviation is not None:
                yield msg(f"{arg(topic)} at {arg(rate_hz):g} Hz is below the report's guideline ({arg(deviation[1])})")


@dataclass(frozen=True, slots=True)
class LinkFit:
    """The telemetry of a vehicle on one link."""

    link: MeteredLink
    capacity: link_capacity.Capacity
    topics: tuple[TopicFit, ...]
    other_up_bps: float
    """Standing traffic from the site, without telemetry."""
    other_down_bps: float
    thinned_up_bps: float
    """Traffic from the site, standing traffic included, with the topics at the rates at which they fit."""
    thinned_down_bps: float
    crosses: bool
    """Whether DDS is allowed on the link; if not, the result is hypothetical."""

    @property
    def up_bps(self) -> float:
        """Total bit/s up, at the rates of the inventory."""
        return self.other_up_bps + sum(topic.up_bps for topic in self.topics)

    @property
    def down_bps(self) -> float:
        """Total bit/s down, at the rates of the inventory."""
        return self.other_down_bps + sum(topic.down_bps for topic in self.topics)

    @property
    def fits(self) -> bool:
        """Whether the telemetry fits at the rates of the inventory."""
        return self.capacity.admits(self.up_bps, self.down_bps)

    @property
    def fits_thinned(self) -> bool:
        """Whether the telemetry fits with lowered rates, none below what is useful."""
        return self.capacity.admits(self.thinned_up_bps, self.thinned_down_bps)

    @property
    def word(self) -> str:
        """The result as text."""
        return "fits" if self.fits else "fits at reduced rates" if self.fits_thinned else "does not fit"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the link, then about all topics."""
        kept_off = (
            ()
            if self.crosses
            else (msg(f"DDS does not use {arg(self.link.name)}: set `dds: true` at the link to allow it"),)
        )
        return (*kept_off, *(words for topic in self.topics for words in topic.warnings()))

    @property
    def verdict(self) -> Verdict:
        """The verdict at the inventory's rates: FAIL if rates must be lowered, INCONCLUSIVE without a measurement."""
        if not self.fits:
            return Verdict.FAIL
        if self.capacity.doubt:
            return Verdict.INCONCLUSIVE
        return Verdict.WARN if self.warnings else Verdict.PASS

    @property
    def reason(self) -> str:
        """The reason for the verdict."""
        if self.fits:
            return self.capacity.doubt or msg(f"measured, {arg(self.capacity.run)}")
        return msg(f"more than {arg(link_capacity.USABLE):.0%} of the capacity would be used at these rates")

    def costs(self, seconds: int, *, is_thinned: bool = False) -> Bill:
        """Return the cost of this many seconds, both ways, including the site's standing traffic."""
        bps = self.thinned_up_bps + self.thinned_down_bps if is_thinned else self.up_bps + self.down_bps
        return bill(round(bps * seconds / 8), seconds, self.link.tariff if self.link.is_metered else None)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-able data."""
        up, down = self.capacity.pace.up_bps, self.capacity.down_bps
        return {
            "link": self.link.name,
            "verdict": self.verdict.value,
            "word": self.word,
            "reason": self.reason,
            "capacity": {
                "source": self.capacity.source,
                "run": self.capacity.run,
                "up_bps": round(up),
                "down_bps": round(down),
                "rtt_s": self.capacity.pace.rtt_s,
                "loss_up": self.capacity.loss,
                "usable": link_capacity.USABLE,
            },
            "topics": [_topic_as_dict(topic) for topic in self.topics],
            "by_itself": {"up_bps": round(self.other_up_bps), "down_bps": round(self.other_down_bps)},
            "declared": self._totals(self.up_bps, self.down_bps, is_thinned=False),
            "thinned": None if self.fits else self._totals(self.thinned_up_bps, self.thinned_down_bps, is_thinned=True),
            "warnings": list(self.warnings),
        }

    def _totals(self, up_bps: float, down_bps: float, *, is_thinned: bool) -> dict[str, Any]:
        hour, day = (
            self.costs(_HOUR_S, is_thinned=is_thinned),
            self.costs(standing_traffic.DAY_S, is_thinned=is_thinned),
        )
        return {
            "up_bps": round(up_bps),
            "down_bps": round(down_bps),
            "share_up": round(up_bps / self.capacity.pace.up_bps, 4),
            "share_down": round(down_bps / self.capacity.down_bps, 4),
            "hour": dict(hour.as_dict()),
            "day": dict(day.as_dict()),
        }


def _topic_as_dict(topic: TopicFit) -> dict[str, Any]:
    cost = topic.cost
    return {
        "topic": topic.topic.topic,
        "data": topic.topic.data.value,
        "reliable": topic.topic.reliable,
        "size_bytes": topic.topic.size_bytes,
        "rate_hz": topic.topic.rate_hz,
        "fits_at_hz": topic.rate_hz,
        "most_hz_alone": topic.most_hz,
        "fragments": cost.fragments,
        "message_bytes_up": round(cost.bytes_up, 1),
        "message_packets_up": round(cost.packets_up, 2),
        "message_bytes_down": round(cost.bytes_down, 1),
        "message_packets_down": round(cost.packets_down, 2),
        "up_bps": round(topic.up_bps),
        "down_bps": round(topic.down_bps),
        "share_up": round(topic.share, 4),
        "seconds_a_message": round(topic.seconds, 4),
        "message_loss": None if topic.message_loss is None else round(topic.message_loss, 4),
    }


@dataclass(frozen=True, slots=True)
class VehicleFit:
    """The telemetry of a vehicle on the links of a site, in order of preference."""

    site: str
    vehicle: str
    middleware: model.RosMiddleware
    subscribers: int
    links: tuple[LinkFit, ...]

    @property
    def exit(self) -> errors.ExitCode:
        """The exit code: done if every requested link is measured and the telemetry fits at the inventory's rates."""
        green = all(link.verdict in {Verdict.PASS, Verdict.WARN} for link in self.links)
        return errors.ExitCode.DONE if green else errors.ExitCode.CHECKS_FAILED

    def as_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        return {
            "exit": int(self.exit),
            "errors": [],
            "site": self.site,
            "vehicle": self.vehicle,
            "middleware": self.middleware.value,
            "subscribers": self.subscribers,
            "links": [link.as_dict() for link in self.links],
        }


def vehicle_fit(  # noqa: PLR0913 - what a person types, and the moment
    inventory: inventory.Inventory,
    stores: Sequence[Store],
    site: str,
    vehicle: str,
    now: datetime,
    *,
    link: str | None = None,
    run: str | None = None,
) -> VehicleFit:
    """Compute the fit; `stores`: real runs first, then rehearsed ones, whose runs are used only by name.

    Without `stores`, only the inventory is used. Raises NoMatchError without such a site, vehicle, link or run, or if
    nothing is published; UsageError; DamagedStateError.
    """
    topics = _telemetry(inventory, site, vehicle)
    profile, subscribers = (
        traffic_budget.publishing_profile(inventory, site),
        traffic_budget.control_centres(inventory),
    )
    if profile is None or not subscribers:
        raise errors.NoMatchError(
            f"no device at {arg(site)} publishes to a control centre",
            hint="add a control centre to the inventory, and a gateway or a `dds:` peer at the site",
        )
    selected_run = None if run is None else link_capacity.named_run(stores, site, run)
    links, flows = (
        links_of(inventory, site),
        {each.link.name: each for each in traffic_budget.standing_traffic(inventory, site)},
    )
    without = links_without_dds(inventory, site)
    fits, days = [], inventory.sites[site].checklist.qualified_within_days
    for site_link in _links(inventory, site, link, selected_run):
        measured_run = selected_run or (link_capacity.newest_run(stores[0], site, site_link) if stores else None)
        capacity = link_capacity.capacity_of(site_link, measured_run, now, days)
        by_itself = [
            flow for flow in flows[site_link.name].flows if flow.source is not standing_traffic.TrafficSource.TELEMETRY
        ]
        other = (
            sum(flow.up for flow in by_itself) * 8 / standing_traffic.DAY_S,
            sum(flow.down for flow in by_itself) * 8 / standing_traffic.DAY_S,
        )
        carrier = _LinkLoad(capacity, profile.messages, subscribers, other, site_link.name not in without)
        fits.append(carrier.fit(links[site_link.name], topics))
    return VehicleFit(site, vehicle, profile.middleware, subscribers, tuple(fits))


def unfit_vehicles(pilot_inventory: inventory.Inventory, now: datetime) -> Iterator[inventory.Finding]:
    """Yield a warning for each vehicle tested at a site whose telemetry fits none of its links.

    The warning is at the site's first link. The inventory's rates count; a vehicle that fits one link with lowered
    rates is not reported.
    """
    for name, site in pilot_inventory.sites.items():
        vehicle_names = site.checklist.vehicles
        for key, vehicle in pilot_inventory.vehicles.items():
            if not vehicle.telemetry or (vehicle_names is not None and key not in vehicle_names):
                continue
            with suppress(errors.NoMatchError):
                fit = vehicle_fit(pilot_inventory, (), name, key, now)
                if not any(link.fits_thinned and link.crosses for link in fit.links):
                    message = msg(
                        f"no DDS link of {arg(name)} carries what `{arg(key)}` publishes, even at the lowest useful "
                        "rates"
                    )
                    hint = msg(
                        f"`provision measure fit site={arg(name)} vehicle={arg(key)}` shows details, and what would fit"
                    )
                    yield inventory.Finding.at(pilot_inventory.places[name, site.bearers[0].name], message, hint)


def require_vehicle(pilot_inventory: inventory.Inventory, site: str, vehicle: str) -> None:
    """Raise UsageError or NoMatchError, with the existing choices, for an unknown site or vehicle."""
    if site == inventory.ALL:
        raise errors.UsageError(
            "`provision measure fit` takes one site at a time", hint="type its name: `site=coastal`"
        )
    inventory.choose(pilot_inventory, site)
    if vehicle not in pilot_inventory.vehicles:
        near, choices = (
            errors.nearest(vehicle, pilot_inventory.vehicles),
            msg(f"vehicles: {arg(join(', ', pilot_inventory.vehicles))}"),
        )
        hint = msg(f"did you mean `{arg(near)}`? {arg(choices)}") if near else choices
        raise errors.NoMatchError(f"vehicle `{arg(vehicle)}` does not exist", hint=hint)


def _telemetry(inventory: inventory.Inventory, site: str, vehicle: str) -> tuple[model.TelemetryTopic, ...]:
    require_vehicle(inventory, site, vehicle)
    topics = inventory.vehicles[vehicle].telemetry
    if not topics:
        raise errors.NoMatchError(
            f"`{arg(vehicle)}` has no `telemetry:`: its data rates are unknown",
            hint="set its topics in group_vars/all/vehicles.yml (see docs/measuring.md)",
        )
    return topics


def _links(
    inventory: inventory.Inventory, site: str, link: str | None, selected_run: SavedRun | None
) -> Sequence[model.Link]:
    if selected_run is not None:
        if link is not None and link != selected_run.run.link:
            raise errors.UsageError(
                f"run {arg(selected_run.run.id)} measured {arg(selected_run.run.link)}, not {arg(link)}",
                hint="remove `link=`",
            )
        link = selected_run.run.link
    return inventory.sites[site].bearers if link is None else (link_named(inventory, site, link),)


@dataclass(frozen=True, slots=True)
class _LinkLoad:
    """A link, and how topics are sent over it."""

    capacity: link_capacity.Capacity
    messages: standing_traffic.DdsMessages
    subscribers: int
    other: tuple[float, float]
    """Other traffic on the link, up and down, in bit/s."""
    crosses: bool

    def fit(self, link: MeteredLink, topics: Sequence[model.TelemetryTopic]) -> LinkFit:
        rates = self._thin_rates(topics)
        up, down = self._load(topics, rates)
        fits = tuple(self._fit_topic(topic, rate) for topic, rate in zip(topics, rates, strict=True))
        return LinkFit(link, self.capacity, fits, *self.other, up, down, self.crosses)

    def _cost(self, topic: model.TelemetryTopic, rate_hz: float) -> standing_traffic.MessageCost:
        return self.messages.cost(replace(traffic_budget.steady(topic), rate_hz=rate_hz), self.capacity.pace)

    def _topic_load_bps(self, topic: model.TelemetryTopic, rate_hz: float) -> tuple[float, float]:
        cost, each = self._cost(topic, rate_hz), rate_hz * self.subscribers * 8
        return cost.bytes_up * each, cost.bytes_down * each

    def _load(self, topics: Sequence[model.TelemetryTopic], rates: Sequence[float]) -> tuple[float, float]:
        loads = [self._topic_load_bps(topic, rate) for topic, rate in zip(topics, rates, strict=True)]
        return self.other[0] + sum(up for up, _ in loads), self.other[1] + sum(down for _, down in loads)

    def _fits_capacity(self, topics: Sequence[model.TelemetryTopic], rates: Sequence[float]) -> bool:
        return self.capacity.admits(*self._load(topics, rates))

    def _thin_rates(self, topics: Sequence[model.TelemetryTopic]) -> list[float]:
        """Return the rates at which all topics fit, as far as possible."""
        rates = [topic.rate_hz for topic in topics]
        for data in _THINNED_FIRST:
            if self._fits_capacity(topics, rates):
                break
            lowest = [
                topic.useful_hz if topic.data is data else rate for topic, rate in zip(topics, rates, strict=True)
            ]
            rates = self._between(topics, lowest, rates) if self._fits_capacity(topics, lowest) else lowest
        return rates

    def _between(
        self, topics: Sequence[model.TelemetryTopic], low: Sequence[float], high: Sequence[float]
    ) -> list[float]:
        """Return the highest fitting rates at one common position between `low`, which fits, and `high`."""

        def rates_at(share: float) -> list[float]:
            return [least + share * (most - least) for least, most in zip(low, high, strict=True)]

        below, above = 0.0, 1.0
        for _ in range(_STEPS):
            middle = (below + above) / 2
            below, above = (middle, above) if self._fits_capacity(topics, rates_at(middle)) else (below, middle)
        return [
            rate if rate == most else _rounded_down(rate, least)
            for rate, least, most in zip(rates_at(below), low, high, strict=True)
        ]

    def _fit_topic(self, topic: model.TelemetryTopic, rate_hz: float) -> TopicFit:
        cost, pace, loss = self._cost(topic, topic.rate_hz), self.capacity.pace, self.capacity.loss
        up, down = self._topic_load_bps(topic, topic.rate_hz)
        return TopicFit(
            topic,
            rate_hz,
            cost,
            up,
            down,
            up / pace.up_bps,
            pace.sends_in_s(cost.bytes_up * self.subscribers),
            _rounded_down(link_capacity.USABLE / pace.sends_in_s(cost.bytes_up * self.subscribers), 0.0),
            None if loss is None else 1 - (1 - loss) ** cost.fragments,
        )


def _rounded_down(rate_hz: float, least: float) -> float:
    """Round a rate down to two digits, but not below `least`."""
    step = 10.0 ** (math.floor(math.log10(rate_hz)) - 1)
    return max(float(f"{math.floor(rate_hz / step + 1e-9) * step:.6g}"), least)
