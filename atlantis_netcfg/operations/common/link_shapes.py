"""The shape of an emulated link in a rehearsal: from the link's `rate:`, or from a measured run.

All links of a rehearsal use this module: routers, computers, and the test packets of `provision measure link`. A
profile replaces the values of the inventory for the link of its name; what it has not measured (a rate) stays as in the
inventory. Estimates and timeouts still use the inventory, as they would on the real link.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.emulator.udp_link import DrawnGap, LinkShape
from atlantis_netcfg.links.qualify.profile import read_profile
from atlantis_netcfg.operations.common.session_link import LAN

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links.qualify.profile import DirectionProfile, LinkProfile

LinkShapes = tuple[LinkShape, LinkShape]
"""The direction from the site, and the one to it."""
_HOLDS = 0.5
"""Share of the train's interval for which a measured delay is kept: the train has no finer resolution."""
_HOUR_S = 3600.0
_MEDIAN = 2


@dataclass(frozen=True, slots=True)
class Replay:
    """A measured run that a rehearsal replays as a link."""

    profile: LinkProfile
    name: str
    """The run's name as a person gave it."""

    @property
    def words(self) -> str:
        """The replay as text, shown before a rehearsal."""
        profile = self.profile
        rtt_ms = 1000 * (_median(profile.up) + _median(profile.down))
        origin = ", itself a rehearsal" if profile.emulated else ""
        return msg(
            f"Replay: link {arg(profile.link)} as measured by run {arg(profile.run)} at "
            f"{arg(profile.site)}{arg(origin)}: {arg(rtt_ms):.0f} ms, loss {arg(100 * profile.up.loss):.1f} % up and "
            f"{arg(100 * profile.down.loss):.1f} % down, {arg(len(profile.gaps))} outages in "
            f"{arg(profile.recorded_s):.0f} s"
        )

    @property
    def not_rehearsed(self) -> str:
        """The limit that a report states because of the replay."""
        origin = ", which was itself a rehearsal" if self.profile.emulated else ""
        return msg(
            f"link {arg(self.profile.link)} in its current state: this was a replay of run "
            f"{arg(self.profile.run)}{arg(origin)}"
        )

    def refuse_elsewhere(self, inventory: Inventory, sites: Collection[str]) -> None:
        """Raise UsageError if no site has the replayed link: the rehearsal would ignore the profile."""
        links = [link.name for site in sites for link in inventory.sites[site].bearers]
        if self.profile.link not in links:
            raise UsageError(
                f"`--profile {arg(self.name)}`: the run measured link `{arg(self.profile.link)}`, which "
                f"{arg(join(', ', sites))} does not have",
                hint=f"its links are: {arg(join(', ', dict.fromkeys(links)) or 'none')}",
            )


def link_shapes(link: Link, replay: Replay | None = None) -> LinkShapes:
    """Return a link's shapes up and down; `replay` applies if it is of this link."""
    rate = link.rate
    if replay is not None and replay.profile.link == link.name:
        return build_shapes(replay.profile, rate.up_kbps * 1000, rate.down_kbps * 1000)
    gaps = tuple(DrawnGap(gap.length_s) for gap in rate.gaps for _ in range(gap.per_hour))
    up, down = (
        LinkShape(
            rate_bps=kbps * 1000,
            delay_s=rate.rtt_ms / 2000,
            jitter_s=rate.jitter_ms / 1000,
            loss=rate.loss,
            gaps=gaps,
            gap_cycle_s=_HOUR_S,
        )
        for kbps in (rate.up_kbps, rate.down_kbps)
    )
    return up, down


def shapes_to(inventory: Inventory, site: str, via: str, replay: Replay | None = None) -> LinkShapes:
    """Return the shapes of a site's link or of the technician's cable."""
    for link in inventory.sites[site].bearers:
        if link.name == via:
            return link_shapes(link, replay)
    up, down = (LinkShape(rate_bps=rate, delay_s=LAN.rtt_s / 2) for rate in (LAN.rate_up_bps, LAN.rate_down_bps))
    return up, down


def build_shapes(profile: LinkProfile, up_bps: float | None, down_bps: float | None) -> LinkShapes:
    """Build a profile's shapes; the given rates are used where the profile has none."""
    up = _shape(profile, profile.up, up_bps, tuple(DrawnGap(gap.seconds, not gap.up) for gap in profile.gaps))
    down = _shape(profile, profile.down, down_bps, tuple(DrawnGap(gap.seconds, not gap.down) for gap in profile.gaps))
    return up, down


def _shape(
    profile: LinkProfile, direction: DirectionProfile, rate_bps: float | None, gaps: tuple[DrawnGap, ...]
) -> LinkShape:
    """Build one shape; the test packet's sending time is subtracted from its delay, as the link adds it again."""
    rate = direction.rate_bps or rate_bps
    sending_s = 0.0 if rate is None else profile.packet_octets * 8 / rate
    return LinkShape(
        rate_bps=rate,
        loss=direction.loss,
        duplicates=direction.duplicates,
        reordering=direction.reordered,
        reorder_s=direction.reorder_s,
        mtu=direction.mtu,
        delays_s=tuple(max(0.0, delay - sending_s) for delay in direction.delays_s),
        hold_s=_HOLDS * profile.interval_s,
        gaps=gaps,
        gap_cycle_s=profile.recorded_s,
        even=True,
    )


def _median(direction: DirectionProfile) -> float:
    return direction.delays_s[len(direction.delays_s) // _MEDIAN]


def open_replay(name: str, roots: Sequence[Path], sites: Sequence[str]) -> Replay:
    """Find a run of these sites by name, or a path; raise NoProfile, or UsageError if there is none."""
    path = Path(name).expanduser()
    matches = [folder for root in roots for site in sites if (folder := root / site / "qualify" / name).is_dir()]
    if "/" not in name and matches:
        return Replay(read_profile(matches[0]), name)
    if path.exists():
        return Replay(read_profile(path), name)
    folders = [folder for root in roots for site in sites for folder in (root / site / "qualify").glob("*/")]
    run_names = sorted(folder.name for folder in folders)
    latest = msg(f"its latest runs: {arg(join(', ', run_names[-3:]))}")
    hint = latest if run_names else "measure the link first; the folder of a run is accepted, too"
    raise UsageError(
        f"`--profile {arg(name)}`: {arg(join(', ', sites))} has no such run, and there is no such file", hint=hint
    )
