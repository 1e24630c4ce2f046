"""Images of gateway computers: customised offline and without root, written to a card, and read back.

Nothing here knows the declaration: `operations.image` says what a host shall be. What needs the board itself is not
promised: no ODROID was available, so that only the first one shows whether a card boots there.
"""

from __future__ import annotations
