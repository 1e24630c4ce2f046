"""Images of gateway computers: customised offline without root, written to a card, and read back.

Nothing here reads the inventory: `operations.image` builds the desired state of a host. No ODROID was available: only
the first one will show whether a card boots there.
"""

from __future__ import annotations
