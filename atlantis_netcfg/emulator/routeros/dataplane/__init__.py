"""The data plane of an emulated router: a network namespace of Linux that carries packets as its current rows say."""

NOT_REHEARSED = (
    "packets: every link and tunnel is taken as up; queues, DHCP, DNS and scripts of the routers are not tried",
)
