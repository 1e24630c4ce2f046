"""ROS 2 and its middleware: participants and DDS implementation. `group_vars/all/pilot.yml`, key `dds`."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, StrictBool, StrictFloat, StrictInt

from atlantis_netcfg.inventory.model import _base

if TYPE_CHECKING:
    from atlantis_netcfg.inventory.model.computer import ServerComputer


class RosDistribution(StrEnum):
    """Releases of ROS 2 that a gateway may run."""

    FOXY = "foxy"
    HUMBLE = "humble"
    JAZZY = "jazzy"


class RosMiddleware(StrEnum):
    """What `RMW_IMPLEMENTATION` takes; all robots use the same."""

    FAST_DDS = "rmw_fastrtps_cpp"
    CYCLONE_DDS = "rmw_cyclonedds_cpp"


class DdsPath(StrEnum):
    """By which addresses the participants talk."""

    VPN = "vpn"
    LAN = "lan"


class DdsPeer(_base.Model):
    """A computer that talks DDS and is no host of the inventory: a robot's own, a partner's control station."""

    name: _base.Name
    """What it is called here."""
    address: _base.Address
    """In the VPN, or in a LAN that is routed, as `over` has it."""
    site: _base.Name | None = None
    """Where it works, so that the gateways of other sites do not announce themselves to it; null: anywhere."""


class TelemetryData(StrEnum):
    """What a topic carries, in the words of the report's guidelines on publishing rates (3.3.3)."""

    NUMBERS = "numbers"
    """Numbers and poses: 1 to 4 Hz."""
    IMAGES = "images"
    """Of low resolution: 4 to 5 Hz."""
    POINT_CLOUDS = "point_clouds"
    """Below 1 Hz."""


class TelemetryTopic(_base.Model):
    """A topic that a robot publishes all the time, with its cost on a metered link."""

    topic: _base.Text
    """Its name in ROS, like /sparus/pose."""
    data: TelemetryData
    """What it carries: `numbers` (poses too), `images` or `point_clouds`."""
    rate_hz: Annotated[StrictFloat, Field(gt=0, le=1000)]
    """Messages a second."""
    size_bytes: Annotated[StrictInt, Field(ge=1, le=16_000_000)]
    """Of one message, serialised, as `ros2 topic bw` shows it."""
    reliable: StrictBool = False
    """True where publisher and subscriber want every message to arrive; the report's subscribers do not (3.3.3)."""
    least_hz: Annotated[StrictFloat, Field(gt=0, le=1000)] | None = None
    """Below so many messages a second it is of no use; null: 1 Hz for `numbers`, one in 10 s for the others."""

    @property
    def useful_hz(self) -> float:
        """Lowest useful rate when thinning out, in Hz: never above the inventory's rate."""
        least = 1.0 if self.data is TelemetryData.NUMBERS else 0.1
        return min(self.rate_hz, least if self.least_hz is None else self.least_hz)


class Dds(_base.Model):
    """How gateways, control centre and robots find each other without multicast."""

    distribution: RosDistribution
    """Of the gateways; the report's is foxy, which has been past its end of life since 2023."""
    middleware: RosMiddleware = RosMiddleware.FAST_DDS
    """Fast DDS is the default of every release above."""
    domain: Annotated[StrictInt, Field(ge=0, le=101)] = 0
    """`ROS_DOMAIN_ID`: above 101 its ports meet those that Linux hands out."""
    over: DdsPath = DdsPath.VPN
    """`lan`: addresses of the sites' LANs, between which the routers route."""
    participants: Annotated[StrictInt, Field(ge=1, le=50)] = 10
    """ROS processes on one computer that are still found; each costs announcements to every peer."""
    processes: Annotated[StrictInt, Field(ge=1, le=50)] = 1
    """ROS processes that really run on a computer at the same time, for what their announcements cost."""
    lease_s: Annotated[StrictInt, Field(ge=120, le=180)] = 120
    """After so long a silence a participant counts as gone, the same for all; a satellite may be silent for 70 s."""
    peers: tuple[DdsPeer, ...] = ()
    """Besides the gateways and control centres, which are peers by themselves."""

    @property
    def ports(self) -> range:
        """Unicast ports of all participants: DDSI-RTPS 2.5, 9.6.2.3, with default values.

        Discovery at 7410 and data at 7411 for the first, two more for each.
        """
        first = 7400 + 250 * self.domain + 10
        return range(first, first + 2 * self.participants)

    @property
    def all_ports(self) -> range:
        """All DDS ports to open on a computer, from multicast discovery to the last unicast port."""
        return range(7400 + 250 * self.domain, self.ports.stop)

    def address_of(self, device: ServerComputer) -> str:
        """Return a computer's DDS address, in LAN or VPN. Raises ValueError if a VPN address is missing."""
        if self.over is DdsPath.LAN:
            return str(device.address)
        if device.vpn_address is None:
            raise ValueError("internal error: a participant over the VPN without a VPN address has passed validation")
        return str(device.vpn_address)
