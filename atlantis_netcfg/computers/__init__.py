"""What a gateway computer should hold, worked out from the declaration without contacting anything.

Each part of a gateway is a pure function `(declaration, host) -> Part`, whose `as_dict` gives the parameters of the
modules that a role runs on the computer. It is final data: no templates, no secrets.
"""

from __future__ import annotations
