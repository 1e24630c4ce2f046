"""The pre-test checklist of a site: what has to be found out, what was, by whom, and who vouches for it.

The list is worked out from the declaration alone, and no X of Table 3 can drop out of it: what no program sees, a
person confirms. What is found is kept line by line on disk, so that an interrupted checklist goes on where it stood.
The closed list is signed by a named person over everything in it, and whoever has it can verify that nothing was changed.
"""

from __future__ import annotations

from atlantis_netcfg.checklist.plan import Checklist, Entry, Scope, plan

__all__ = ["Checklist", "Entry", "Scope", "plan"]
