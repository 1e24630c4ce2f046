"""`make bench`: how long, how many round trips and how many bytes, for us and for the peers beside us.

The same desired state, rendered once from the pilot's inventory, is brought to the same emulated router by each
contender in the way that its own documentation recommends, as a process of its own. A proxy between both, which shares
no code with twin or engine, delays and limits what crosses it and counts what it carries. Afterwards the router's own
export is compared, so that nobody is quicker by doing less without the table saying so.

Beside that race: our own part over hundreds of routers, silent ones among them (`crowd`), and on a computer that has
made a thousand runs (`runs`); and a thousand devices brought into a VPN, by our authority and as certificates by
easy-rsa (`onboarding`).
"""
