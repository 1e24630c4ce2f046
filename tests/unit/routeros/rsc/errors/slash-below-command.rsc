/ip/dns/set/servers 192.0.2.53
