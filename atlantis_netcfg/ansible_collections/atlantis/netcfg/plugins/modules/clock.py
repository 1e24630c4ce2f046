"""Module `atlantis.netcfg.clock`: set a clock that is far off before anything that depends on it runs."""

# ruff: noqa: E402, TID252 - a module begins with its documentation, and Ansible ships what is imported relatively

from __future__ import annotations

DOCUMENTATION = r"""
module: clock
short_description: Set a clock that is far off to the time of the technician's computer
description:
  - A board without a battery wakes up years ago, and then no signature of an archive and no certificate holds.
  - Nothing is done where the clock is near, or follows a time server; the rest is chrony's.
options:
  now: {description: The time of the technician's computer in seconds since 1970., type: float, required: true}
  tolerance_s:
    description: So far off a clock may be. More than a link may be silent, because C(now) is older then.
    type: float
    default: 300
author: ATLANTIS pilot team
"""

EXAMPLES = r"""
- name: Set a clock that is far off
  atlantis.netcfg.clock:
    now: "{{ now().timestamp() }}"
"""

RETURN = r"""
changes:
  description: By how much the clock was off.
  type: list
  elements: str
  returned: always
notes:
  description: Where the clock follows a time server, by how much the technician's computer differs from it.
  type: list
  elements: str
  returned: success
"""

import time
from datetime import datetime, timezone
from typing import Callable

from ansible.module_utils.basic import AnsibleModule

from atlantis_netcfg.core.messages import arg, msg

from ..module_utils.errors import ModuleError
from ..module_utils.programs import ProgramResult, is_there, run

TOLERANCE_S = 300
"""Longer than a request can take: a satellite link may be silent for 70 s, and ssh then retransmits."""
_OLDEST = datetime(2026, 1, 1, tzinfo=timezone.utc)
"""No computer that runs this toolkit has an earlier time."""
_DAY_S = 86400


class Clock:
    """The clock of this computer; tests replace its inputs and outputs."""

    def __init__(
        self,
        *,
        check: bool = False,
        read: Callable[[], float] = time.time,
        write: Callable[[float], None] = lambda now: time.clock_settime(time.CLOCK_REALTIME, now),
        run: Callable[[list[str]], ProgramResult] = run,
    ) -> None:
        self.check = check
        self.read = read
        self.write = write
        self.run = run
        self.changes: list[str] = []
        self.notes: list[str] = []

    def converge(self, now: float, tolerance_s: float = TOLERANCE_S) -> None:
        """Set the clock to `now`, in seconds since 1970, unless it is near or synchronised. Raises ModuleError."""
        if now < _OLDEST.timestamp():
            raise ModuleError(
                f"this laptop's clock is wrong ({arg(_format_time(now))}): it cannot be used to set another clock",
                "set your own computer's clock, then run the same command again",
            )
        was = self.read()
        if abs(was - now) <= tolerance_s:
            return
        off = _describe_offset(was - now)
        if self._follows():
            self.notes.append(
                msg(
                    f"its clock is {arg(off)} {'ahead' if was > now else 'behind'} of your computer's and follows a "
                    "time server: check your computer's clock"
                )
            )
            return
        if not self.check:
            self._set(now, was)
        self.changes.append(
            msg(f"clock set: it was {arg(off)} {'ahead' if was > now else 'behind'} ({arg(_format_time(was))})")
        )

    def _set(self, now: float, was: float) -> None:
        try:
            self.write(now)
        except OSError as error:
            off = _describe_offset(was - now)
            raise ModuleError(
                f"the clock of this computer is {arg(off)} {'ahead' if was > now else 'behind'}, and cannot be set "
                f"here: {arg(error.strerror)}. Keys and certificates do not work with such a clock",
                "a container uses the clock of its computer: set it there, or give the container CAP_SYS_TIME",
            ) from error
        for keep in (["hwclock", "--systohc", "--utc"], ["fake-hwclock", "save"]):
            if is_there(keep[0]):
                self.run(keep)  # a board without a clock of its own has nothing to keep it in

    def _follows(self) -> bool:
        """Return whether a time daemon has synchronised the clock, according to the kernel."""
        return self.run(["timedatectl", "show", "--property", "NTPSynchronized", "--value"]).output.strip() == "yes"


def _describe_offset(seconds: float) -> str:
    size = abs(seconds)
    return msg(f"{arg(size / _DAY_S):.0f} days" if size >= 2 * _DAY_S else f"{arg(size):.0f} s")


def _format_time(moment: float) -> str:
    return datetime.fromtimestamp(moment, timezone.utc).strftime("%Y-%m-%d %H:%M UTC")


ARGUMENTS = {"now": {"type": "float", "required": True}, "tolerance_s": {"type": "float", "default": TOLERANCE_S}}


def main() -> None:
    """Run the module."""
    module = AnsibleModule(ARGUMENTS, supports_check_mode=True)
    clock = Clock(check=module.check_mode)
    try:
        clock.converge(module.params["now"], module.params["tolerance_s"])
    except ModuleError as refused:
        module.fail_json(msg=refused.message, hint=refused.hint, changes=[])
    module.exit_json(changed=bool(clock.changes), changes=clock.changes, notes=clock.notes)


if __name__ == "__main__":
    main()
