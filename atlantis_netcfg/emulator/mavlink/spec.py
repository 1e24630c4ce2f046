"""One emulated autopilot: healthy and disarmed by default, its pilot moving the sticks; each field changes that."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

__all__ = ["AutopilotSpec"]


class AutopilotSpec(BaseModel):
    """An autopilot, its remote control, and the stream that its companion computer forwards."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    system_id: int = Field(default=1, ge=1, le=255)
    version: int = Field(default=2, ge=1, le=2)
    """Of MAVLink."""
    every_s: float = Field(default=0.1, gt=0)
    """Between two rounds of all messages. Autopilots send heartbeats once a second; rehearsals are in a hurry."""
    armed: bool = False
    armed_after: int | None = None
    """Armed from so many rounds on."""
    heartbeat: bool = True
    channels: int | None = Field(default=16, ge=0, le=18)
    """`chancount`; None: no RC_CHANNELS is in the stream."""
    channels_stop_after: int | None = None
    """So many rounds with RC_CHANNELS, then without."""
    moving: int = Field(default=4, ge=0, le=18)
    """So many channels follow the sticks, which go round; all others stand still."""
    odd_us: int | None = None
    """Value of channel 3."""
    rssi: int = Field(default=200, ge=0, le=255)
    """255: not known."""
    rssi_swing: int = Field(default=0, ge=0, le=254)
    """Every other round is so much lower."""
    status: bool = True
    """False: no SYS_STATUS is in the stream."""
    receiver_present: bool = True
    receiver_enabled: bool = True
    receiver_healthy: bool = True
    ground_station: bool = False
    """A ground station (system 255) is in the same stream."""
    other_system: int | None = None
    """Another vehicle is in the same stream, disarmed."""
    corrupted: int = 0
    """Of so many frames the last is damaged; 0: none."""
    garbage: bool = False
    """Another program's datagrams, no frame among them."""
    silent: bool = False
    silent_after: int | None = None
    """So many rounds, then none."""
    split: bool = False
    """Frames go over the borders of datagrams, as a serial-to-UDP bridge cuts them."""
