"""What a RutOS twin is made of; plain data that survives a round trip through JSON."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

NOT_REHEARSED = (
    "Teltonika RutOS: how long its modem takes to register, and the link to it, which is neither slow nor metered here",
)


class _Spec(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class RutosSim(_Spec):
    """The card in slot 1."""

    pin: str | None = None
    """What unlocks it; None: it asks for none."""
    tries: int = Field(default=3, ge=0)
    home: str = "26803"
    """PLMN of its operator."""
    apn: str | None = None
    """The only APN that its subscription has; None: any, also none."""
    listed: bool = True
    """The unit's own list of operators has that APN, so that `auto_apn` finds it."""


class RutosNetwork(_Spec):
    """What is on the air."""

    plmn: str = "26803"
    operator: str = "EXAMPLE-OPERATOR"
    denies: bool = False
    silent: bool = False
    """No coverage."""


class RutosSpec(_Spec):
    """One emulated Teltonika router."""

    name: str
    serial_number: str = "0000000000"
    reader: str = "reader"
    """A user of its own interface who may only read."""
    reader_password: str = ""
    admin: str = "root"
    """Who may log in over SSH."""
    admin_password: str = ""
    sim: RutosSim | None = RutosSim()
    """None: the slot is empty."""
    network: RutosNetwork = RutosNetwork()
    api: bool = True
    """The API of RutOS 7; without it only `/ubus`."""
    old_names: bool = True
    """Field names of the record in devices.md (`netstate`, `state`, `oper`, `signal`); else those of newer firmware."""
    numbers_as_text: bool = False
    hidden: tuple[str, ...] = ()
    """Pages that the reader may not see: HTTP 403."""
    missing: tuple[str, ...] = ()
    """Pages that this firmware does not have: HTTP 501."""
    token_s: float = Field(default=299.0, gt=0)
    """How long a token lasts; `expires` of the answer to the login."""
    mobile_section: bool = True
    """`/etc/config/network` has the interface `mob1s1a1`."""
