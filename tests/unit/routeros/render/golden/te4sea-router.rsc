# te4sea-router (Support vessel TE4SEA): desired configuration

# Identity: the inventory's name, and who takes care of this router.
/system identity
set name=te4sea-router
/system note
set note="ATLANTIS te4sea-router (Support vessel TE4SEA): provisioned from the pilot's declaration. Change the declaration, not the router." show-at-login=yes
# Ports have their factory names, which are those of the sockets: a port that somebody has renamed gets its name back. The
# comment says what a port is for. Power goes to the radio heads; of two ports the one with the lower poe-priority keeps
# its power longer. Ports without a use are off, also those that nobody has declared, like the cage of an SFP.
# atlantis:undeclared /interface ethernet disabled=yes
/interface ethernet
set [ find default-name=ether1 ] comment="atlantis: 4g" disabled=no name=ether1 poe-out=auto-on poe-priority=2
set [ find default-name=ether2 ] comment="atlantis: satellite" disabled=no name=ether2 poe-out=auto-on poe-priority=0
set [ find default-name=ether3 ] comment="atlantis: lan" disabled=no name=ether3
set [ find default-name=ether4 ] comment="atlantis: lan" disabled=no name=ether4
set [ find default-name=ether5 ] comment="atlantis: off" disabled=yes name=ether5
set [ find default-name=ether6 ] comment="atlantis: off" disabled=yes name=ether6
set [ find default-name=ether7 ] comment="atlantis: off" disabled=yes name=ether7
set [ find default-name=ether8 ] comment="atlantis: management" disabled=no name=ether8
# Access point for vehicles that are stations. It is a port of the LAN, so that they get their reserved addresses and the way
# into the VPN. An isolated one hands nothing from one station to another.
/interface wifi
set [ find default-name=wifi1 ] channel.band=5ghz-ax channel.frequency=5540 channel.skip-dfs-channels=10min-cac channel.width=20mhz comment="atlantis: access point" configuration.country=Portugal configuration.installation=outdoor configuration.mode=ap configuration.ssid=EXAMPLE-ATLANTIS-TE4SEA datapath.client-isolation=yes disabled=no name=wifi1 security.authentication-types=wpa2-psk security.passphrase=EXAMPLE-te4sea-access-point security.wps=disable
# LAN: one bridge over the LAN ports. rstp, because on a quay a cable is soon plugged in twice, and one loop would stop the
# whole site. The management port never joins the bridge: it is the way in when the bridge is at fault.
/interface bridge
add comment="atlantis: LAN" name=bridge-lan protocol-mode=rstp
# atlantis:entire /interface bridge port
/interface bridge port
add bridge=bridge-lan comment="atlantis: LAN" interface=ether3
add bridge=bridge-lan comment="atlantis: LAN" interface=ether4
add bridge=bridge-lan comment="atlantis: access point" interface=wifi1
/ip address
add address=10.64.2.1/24 comment="atlantis: LAN" interface=bridge-lan
# The technician's port. This address stands on an adopted router already, and the session that provisions it uses it.
add address=10.64.102.1/24 comment="atlantis: management" interface=ether8
# Links that lead out of the site. Addresses are declared, so no DHCP client: one would bring a default route and name
# servers of its own, and those of a dead link stay behind.
/ip address
add address=10.10.9.2/29 comment="atlantis: 4g" interface=ether1
add address=10.10.10.2/29 comment="atlantis: satellite" interface=ether2
# atlantis:entire /ip dhcp-client
/ip dhcp-client
# Time: certificates are only good while the clock is right. Servers by address, because names may need the VPN and the VPN
# needs the time.
/system clock
set time-zone-autodetect=no time-zone-name=Europe/Lisbon
/system ntp client
set enabled=yes
/system ntp client servers
add address=192.0.2.123 comment="atlantis: ntp1.example.org"
add address=192.0.2.124 comment="atlantis: ntp2.example.org"
# DNS: names of this site, and the VPN's endpoint so that the tunnel needs no name server. Nothing is asked of servers
# outside: none is declared, and questions over the satellite cost money. Only the LAN may ask (see the input chain).
/ip dns
set allow-remote-requests=yes servers=""
/ip dns static
add address=10.64.2.26 comment="atlantis: eca-rov.te4sea.example.org" name=eca-rov.te4sea.example.org
add address=10.64.2.21 comment="atlantis: girona500.te4sea.example.org" name=girona500.te4sea.example.org
add address=10.64.2.25 comment="atlantis: mares.te4sea.example.org" name=mares.te4sea.example.org
add address=10.64.2.22 comment="atlantis: sparus.te4sea.example.org" name=sparus.te4sea.example.org
add address=10.64.2.24 comment="atlantis: stork.te4sea.example.org" name=stork.te4sea.example.org
add address=10.10.9.1 comment="atlantis: te4sea-4g.te4sea.example.org" name=te4sea-4g.te4sea.example.org
add address=10.64.2.10 comment="atlantis: te4sea-gateway.te4sea.example.org" name=te4sea-gateway.te4sea.example.org
add address=10.64.2.1 comment="atlantis: te4sea-router.te4sea.example.org" name=te4sea-router.te4sea.example.org
add address=10.10.10.1 comment="atlantis: te4sea-sat.te4sea.example.org" name=te4sea-sat.te4sea.example.org
add address=10.64.2.23 comment="atlantis: zarco.te4sea.example.org" name=zarco.te4sea.example.org
add address=203.0.113.2 comment="atlantis: vpn.example.org" name=vpn.example.org
# VPN: this router is the site's end. RouterOS does not negotiate ciphers, so cipher and auth equal the server's; auth=null is
# what GCM ciphers need up to 7.16. From 7.17 on `provision vpn install` imports the interface, for a key of tls-crypt comes
# by no other way, and tls-crypt wants sha256. The server's certificate is compared with connect-to, a name that our own DNS
# answers. Routes are declared below; what the server pushes is ignored.
# atlantis:run-time /interface ovpn-client auth=null auth=sha256
/interface ovpn-client
add add-default-route=no auth=null certificate=atlantis-vpn cipher=aes256-gcm comment="atlantis: VPN" connect-to=vpn.example.org disabled=no mode=ip name=ovpn-scc password=EXAMPLE-vpn-te4sea port=1194 protocol=udp route-nopull=yes tls-version=only-1.2 use-peer-dns=no user=te4sea-router verify-server-certificate=yes
# Interface lists: the firewall speaks of these. Ours entirely, because one wrong member opens the LAN to the world.
/interface list
add comment="atlantis: robots, gateway, operators" name=LAN
add comment="atlantis: the technician's port" name=MGMT
add comment="atlantis: the tunnel" name=VPN
add comment="atlantis: links by which this site reaches the world" name=WAN
# atlantis:entire /interface list member
/interface list member
add comment="atlantis: LAN" interface=bridge-lan list=LAN
add comment="atlantis: management" interface=ether8 list=MGMT
add comment="atlantis: VPN" interface=ovpn-scc list=VPN
add comment="atlantis: 4g" interface=ether1 list=WAN
add comment="atlantis: satellite" interface=ether2 list=WAN
# DHCP for the LAN. Reservations give each robot and computer the address by which the others know it.
/ip pool
add comment="atlantis: LAN" name=dhcp-lan ranges=10.64.2.100-10.64.2.199
/ip dhcp-server
add address-pool=dhcp-lan comment="atlantis: LAN" disabled=no interface=bridge-lan lease-time=1h name=dhcp-lan
/ip dhcp-server network
add address=10.64.2.0/24 comment="atlantis: LAN" dns-server=10.64.2.1 domain=te4sea.example.org gateway=10.64.2.1 ntp-server=192.0.2.123,192.0.2.124
/ip dhcp-server lease
add address=10.64.2.10 comment="atlantis: te4sea-gateway" mac-address=02:00:5E:00:02:10 server=dhcp-lan
add address=10.64.2.21 comment="atlantis: girona500" mac-address=02:00:5E:00:01:21 server=dhcp-lan
add address=10.64.2.22 comment="atlantis: sparus" mac-address=02:00:5E:00:01:22 server=dhcp-lan
add address=10.64.2.23 comment="atlantis: zarco" mac-address=02:00:5E:00:01:23 server=dhcp-lan
add address=10.64.2.24 comment="atlantis: stork" mac-address=02:00:5E:00:01:24 server=dhcp-lan
add address=10.64.2.25 comment="atlantis: mares" mac-address=02:00:5E:00:01:25 server=dhcp-lan
add address=10.64.2.26 comment="atlantis: eca-rov" mac-address=02:00:5E:00:01:26 server=dhcp-lan
# Address lists that the filter consults; ours entirely, because an entry is a permission.
# atlantis:entire /ip firewall address-list
/ip firewall address-list
add address=10.64.2.10 comment="atlantis: te4sea-gateway, ours, in the LAN" list=hosts
add address=10.80.0.0/16 comment="atlantis: tunnel addresses, behind the VPN" list=remote
add address=10.64.1.0/24 comment="atlantis: coastal LAN, behind the VPN" list=remote
add address=10.64.0.0/24 comment="atlantis: scc LAN, behind the VPN" list=remote
add address=203.0.113.2 comment="atlantis: VPN server, far end of measurements, also by satellite" list=sat-allow
add address=192.0.2.123 comment="atlantis: ntp1.example.org, also by satellite" list=sat-allow
add address=192.0.2.124 comment="atlantis: ntp2.example.org, also by satellite" list=sat-allow
# Filter. No fasttrack: its packets skip the filter, and with it the satellite's allow-list.
# atlantis:entire /ip firewall filter
/ip firewall filter
# Input: what may speak to the router itself. Management first, whatever else is wrong below, and each network of managers by
# the interfaces behind which it is: its addresses are only names to whoever sends from elsewhere. The LAN's rules name its prefix:
# at the control centre, partners of the VPN also come in by the LAN, from the VPN server.
add action=accept chain=input comment="atlantis: management" dst-port=22,8729 in-interface-list=MGMT protocol=tcp src-address=10.64.102.0/24
add action=accept chain=input comment="atlantis: ping from management" in-interface-list=MGMT protocol=icmp src-address=10.64.102.0/24
add action=accept chain=input comment="atlantis: management by the VPN" dst-port=22,8729 in-interface-list=VPN protocol=tcp src-address=10.80.0.0/24
add action=accept chain=input comment="atlantis: ping from management by the VPN" in-interface-list=VPN protocol=icmp src-address=10.80.0.0/24
# Forward: gateways ask by an echo with DSCP 1, for two hops, whether DDS may cross the link that is in use. Where it may not they
# are told so, and send none. No reply comes from any other link, and nothing of this leaves the site.
add action=reject chain=forward comment="atlantis: no DDS over satellite" dscp=1 out-interface=ether2 protocol=icmp reject-with=icmp-admin-prohibited
# Satellite: only declared targets, each on its own port, ahead of everything that accepts, so that connections which began
# on a cheaper link do not go on here. The chains return what is allowed; the rules below them then decide as for any link.
# A chain stands whole between the jump to it and what follows that jump: in this order rules are added without a gap.
# The terminal's own pages cost no airtime: the technician and the router may reach them.
add action=accept chain=output comment="atlantis: satellite, the terminal itself" dst-address=10.10.10.0/29 out-interface=ether2
add action=jump chain=output comment="atlantis: satellite, allow-list" jump-target=to-satellite out-interface=ether2
add action=accept chain=forward comment="atlantis: technician to the terminal of satellite" dst-address=10.10.10.0/29 in-interface-list=MGMT out-interface=ether2 src-address=10.64.102.0/24
add action=jump chain=forward comment="atlantis: satellite, allow-list" jump-target=to-satellite out-interface=ether2
add action=return chain=to-satellite comment="atlantis: VPN server" dst-address=203.0.113.2 dst-address-list=sat-allow dst-port=1194 protocol=udp
add action=return chain=to-satellite comment="atlantis: ntp1.example.org" dst-address=192.0.2.123 dst-address-list=sat-allow dst-port=123 protocol=udp
add action=return chain=to-satellite comment="atlantis: ntp2.example.org" dst-address=192.0.2.124 dst-address-list=sat-allow dst-port=123 protocol=udp
add action=return chain=to-satellite comment="atlantis: far end of measurements" dst-address=203.0.113.2 dst-address-list=sat-allow dst-port=862 protocol=udp
add action=log chain=to-satellite comment="atlantis: what is kept off, a sample" limit=10/1m,5:packet log-prefix="drop satellite"
add action=drop chain=to-satellite comment="atlantis: satellite, everything else"
# What has come in is paid for already; only answers of the same targets go on, which also counts them one by one. An ICMP
# error belongs to a connection of ours wherever it comes from, and without it a path that takes smaller packets is a hole.
add action=jump chain=input comment="atlantis: satellite, what comes in" in-interface=ether2 jump-target=from-satellite
add action=jump chain=forward comment="atlantis: satellite, what comes in" in-interface=ether2 jump-target=from-satellite
add action=return chain=from-satellite comment="atlantis: answers of VPN server" connection-state=established protocol=udp src-address=203.0.113.2 src-address-list=sat-allow src-port=1194
add action=return chain=from-satellite comment="atlantis: answers of ntp1.example.org" connection-state=established protocol=udp src-address=192.0.2.123 src-address-list=sat-allow src-port=123
add action=return chain=from-satellite comment="atlantis: answers of ntp2.example.org" connection-state=established protocol=udp src-address=192.0.2.124 src-address-list=sat-allow src-port=123
add action=return chain=from-satellite comment="atlantis: answers of far end of measurements" connection-state=established protocol=udp src-address=203.0.113.2 src-address-list=sat-allow src-port=862
add action=return chain=from-satellite comment="atlantis: satellite, the terminal itself" connection-state=established src-address=10.10.10.0/29
add action=return chain=from-satellite comment="atlantis: errors on the way" connection-state=related protocol=icmp
add action=log chain=from-satellite comment="atlantis: what is turned away, a sample" limit=10/1m,5:packet log-prefix="drop from satellite"
add action=drop chain=from-satellite comment="atlantis: satellite, everything else that comes in"
# Input again: what may speak to the router itself by any link.
add action=accept chain=input comment="atlantis: answers" connection-state=established,related,untracked
add action=drop chain=input comment="atlantis: invalid" connection-state=invalid
add action=accept chain=input comment="atlantis: DHCP of hosts without address" dst-port=67 in-interface-list=LAN protocol=udp src-address=0.0.0.0
add action=accept chain=input comment="atlantis: DHCP and DNS" dst-port=53,67 in-interface-list=LAN protocol=udp src-address=10.64.2.0/24
add action=accept chain=input comment="atlantis: DNS, long answers" dst-port=53 in-interface-list=LAN protocol=tcp src-address=10.64.2.0/24
add action=accept chain=input comment="atlantis: ping from the LAN" in-interface-list=LAN protocol=icmp src-address=10.64.2.0/24
add action=log chain=input comment="atlantis: what is dropped, a sample" limit=10/1m,5:packet log-prefix="drop input"
add action=drop chain=input comment="atlantis: everything else"
# Forward: what may pass through.
add action=drop chain=forward comment="atlantis: invalid" connection-state=invalid
# After a change of link, flows of before may go out with the addresses of the LAN: nobody could answer them. New connections
# are left alone here, because source NAT comes after this chain.
add action=drop chain=forward comment="atlantis: stale, not masqueraded" connection-nat-state=!srcnat connection-state=established,related out-interface-list=WAN
add action=accept chain=forward comment="atlantis: answers" connection-state=established,related,untracked
add action=accept chain=forward comment="atlantis: LAN by the best link" in-interface-list=LAN out-interface-list=WAN src-address=10.64.2.0/24
add action=accept chain=forward comment="atlantis: technician to the LAN" in-interface-list=MGMT out-interface-list=LAN src-address=10.64.102.0/24
add action=accept chain=forward comment="atlantis: technician by the best link" in-interface-list=MGMT out-interface-list=WAN src-address=10.64.102.0/24
# Ours reach everything behind the VPN. What else is plugged in may be a partner's robot: of other sites it reaches pings and
# DDS, of the tunnel's addresses what the VPN server lets it. Who may reach this site is decided where all meet, on that server.
add action=accept chain=forward comment="atlantis: our hosts to the VPN" dst-address-list=remote in-interface-list=LAN out-interface-list=VPN src-address-list=hosts
add action=accept chain=forward comment="atlantis: LAN to the VPN" dst-address=10.80.0.0/16 in-interface-list=LAN out-interface-list=VPN src-address=10.64.2.0/24
add action=accept chain=forward comment="atlantis: LAN to other sites, pings" dst-address-list=remote in-interface-list=LAN out-interface-list=VPN protocol=icmp src-address=10.64.2.0/24
add action=accept chain=forward comment="atlantis: LAN to other sites, DDS" dst-address-list=remote dst-port=7410-7429 in-interface-list=LAN out-interface-list=VPN protocol=udp src-address=10.64.2.0/24
add action=accept chain=forward comment="atlantis: VPN to the LAN" dst-address=10.64.2.0/24 in-interface-list=VPN out-interface-list=LAN src-address-list=remote
add action=log chain=forward comment="atlantis: what is dropped, a sample" limit=10/1m,5:packet log-prefix="drop forward"
add action=drop chain=forward comment="atlantis: everything else"
# Output is open but for the satellite: the router itself asks for time, pings its canaries and holds the tunnel.
# NAT. Every uplink is masqueraded, the Wi-Fi bridge to the control centre included: the links are interchangeable, so the far
# end needs no route back to this LAN that would go stale with the link. Sites reach each other inside the VPN, un-NATed,
# where real addresses and the partners' separation hold.
# atlantis:entire /ip firewall nat
/ip firewall nat
add action=masquerade chain=srcnat comment="atlantis: uplinks" out-interface-list=WAN
# MSS: tunnel and terminal add headers, and a TCP segment that must be cut in two doubles its risk of loss. 1300 leaves room
# for either. postrouting also covers the router's own connections.
# atlantis:entire /ip firewall mangle
/ip firewall mangle
add action=change-mss chain=forward comment="atlantis: satellite, what comes in" in-interface=ether2 new-mss=1300 passthrough=yes protocol=tcp tcp-flags=syn tcp-mss=1301-65535
add action=change-mss chain=postrouting comment="atlantis: satellite, what goes out" new-mss=1300 out-interface=ether2 passthrough=yes protocol=tcp tcp-flags=syn tcp-mss=1301-65535
add action=change-mss chain=forward comment="atlantis: VPN, what comes in" in-interface-list=VPN new-mss=1300 passthrough=yes protocol=tcp tcp-flags=syn tcp-mss=1301-65535
add action=change-mss chain=postrouting comment="atlantis: VPN, what goes out" new-mss=1300 out-interface-list=VPN passthrough=yes protocol=tcp tcp-flags=syn tcp-mss=1301-65535
# satellite: who goes first in its queue. The tunnel is control: what robots and operators say to each other is inside.
add action=mark-packet chain=postrouting comment="atlantis: satellite, the tunnel first" dst-address=203.0.113.2 dst-port=1194 new-packet-mark=control out-interface=ether2 passthrough=no protocol=udp
add action=mark-packet chain=postrouting comment="atlantis: satellite, time and names first" dst-port=53,123 new-packet-mark=control out-interface=ether2 passthrough=no protocol=udp
# Queues of thin links: at four fifths of the declared rate packets wait here, where control goes first, and not in the
# terminal, where nobody does. Only what goes out: what comes in has crossed the link already. A queue is short
# (default-small: 10 packets), because what waits too long is stale. Marks: see mangle.
# atlantis:entire /queue tree
/queue tree
add comment="atlantis: satellite" max-limit=281600 name=satellite parent=ether2 queue=default-small
add comment="atlantis: satellite, control" limit-at=140800 max-limit=281600 name=satellite-control packet-mark=control parent=satellite priority=1 queue=default-small
add comment="atlantis: satellite, the rest" limit-at=28160 max-limit=281600 name=satellite-rest packet-mark=no-mark parent=satellite priority=8 queue=default-small
# Failover. A link with canaries is good while one of them answers: default routes lead to the canaries, which are reached
# over that link alone. Equal distance: both must fail before the next link is taken. A satellite is not probed unless a budget
# is declared for it, because probes cost airtime: it is what is left. A blackhole behind each canary keeps it from answering over another link when its
# own is down; scope 30 is above target-scope 11, so default routes do not lead there.
# When a link is left and when it is taken back is decided below, under /tool netwatch; it moves these routes by their
# distance: 10 for each place in the order of preference, and 100 more while the link is given up. Should netwatch stand
# still, traffic moves all the same: at once and without damping, by check-gateway=ping where asking costs nothing, and
# where it costs, by check-gateway=arp, which asks the box at this end only.
/routing table
add comment="atlantis: 4g only" fib name=via-4g
add comment="atlantis: satellite only" fib name=via-satellite
# atlantis:run-time /ip route distance=10 distance=110
# atlantis:entire /ip route
/ip route
add check-gateway=arp comment="atlantis: canary of 4g" dst-address=198.51.100.31/32 gateway=10.10.9.1 scope=10
add blackhole comment="atlantis: canary of 4g, by no other link" distance=254 dst-address=198.51.100.31/32 scope=30
add check-gateway=arp comment="atlantis: canary of 4g" dst-address=198.51.100.32/32 gateway=10.10.9.1 scope=10
add blackhole comment="atlantis: canary of 4g, by no other link" distance=254 dst-address=198.51.100.32/32 scope=30
add comment="atlantis: 4g, while 198.51.100.31 answers" distance=10 dst-address=0.0.0.0/0 gateway=198.51.100.31 target-scope=11
add comment="atlantis: 4g, while 198.51.100.32 answers" distance=10 dst-address=0.0.0.0/0 gateway=198.51.100.32 target-scope=11
add comment="atlantis: satellite, not probed" distance=20 dst-address=0.0.0.0/0 gateway=10.10.10.1
# One table a link, without a way round: a ping from the link's own address tests this link.
add comment="atlantis: 4g only" dst-address=0.0.0.0/0 gateway=10.10.9.1@main routing-table=via-4g
add comment="atlantis: satellite only" dst-address=0.0.0.0/0 gateway=10.10.10.1@main routing-table=via-satellite
# Behind the VPN. While the tunnel is down these addresses lead nowhere, and never out on a link in the clear.
add comment="atlantis: tunnel addresses" dst-address=10.80.0.0/16 gateway=ovpn-scc
add blackhole comment="atlantis: tunnel addresses, by the VPN only" distance=254 dst-address=10.80.0.0/16 scope=30
add comment="atlantis: coastal LAN" dst-address=10.64.1.0/24 gateway=ovpn-scc
add blackhole comment="atlantis: coastal LAN, by the VPN only" distance=254 dst-address=10.64.1.0/24 scope=30
add comment="atlantis: scc LAN" dst-address=10.64.0.0/24 gateway=ovpn-scc
add blackhole comment="atlantis: scc LAN, by the VPN only" distance=254 dst-address=10.64.0.0/24 scope=30
# atlantis:entire /routing rule
/routing rule
# First everything that main knows but its default route (min-prefix=0): neighbours of a link answer from any address.
add action=lookup comment="atlantis: connected and static prefixes" min-prefix=0 table=main
# The tunnel follows the best link even if it began on another: pinned to its first link it would stay on the satellite.
add action=lookup comment="atlantis: VPN by the best link" dst-address=203.0.113.2/32 table=main
add action=lookup-only-in-table comment="atlantis: 4g, from its own address" src-address=10.10.9.2/32 table=via-4g
add action=lookup-only-in-table comment="atlantis: satellite, from its own address" src-address=10.10.10.2/32 table=via-satellite
# When a link is left, and when it is taken back. For each canary three rows:
#   watch    asks all the time. No answer: the link is held if it is in use, and `silence` begins. An answer: `silence`
#            ends, and `steady` begins if the link was held or left. Every test looks again whether that is so, so that a
#            state which somebody else has put there (an old one restored, a route set by hand) is not there for good.
#   silence  the declared hold-down: if not one packet of it is answered, the route by this canary is left. If that was the
#            last good one, so is the link, and its connections are cut: they would go on under its address by the next.
#   steady   the declared fail-back: begins anew until every packet of it is answered; then the link is taken back, and what
#            still goes by links after it is cut, above all the tunnel, which would not move from the satellite by itself.
# A link in use for a time (`provision links use`) has smaller distances: so the rows ask whether a route is left, and not whether it
# is where it is declared.
# Scripts of netwatch run in every device-mode, and may read and write (MikroTik manual, Netwatch). What they change is
# declared as run-time state, so it is no drift. After a start of the router they find out anew; a link that was left stays
# left until it has proved itself.
# atlantis:note /tool netwatch: probes over {4g}, which is metered, use {0.97} MB a day in normal operation; less with a longer `metered_probe_s`
# atlantis:run-time /tool netwatch disabled=yes disabled=no
# atlantis:entire /tool netwatch
/tool netwatch
add comment="atlantis: 4g, by 198.51.100.31" down-script="/tool netwatch disable [find name=\"4g-198.51.100.31-steady\"]; /tool netwatch enable [find name=\"4g-198.51.100.31-silence\"]" host=198.51.100.31 interval=30s name=4g-198.51.100.31-watch startup-delay=30s test-script=":if ([:len [/tool netwatch find name=\"4g-198.51.100.31-watch\" status=up]] > 0) do={:if ([:len [/ip route find comment=\"atlantis: 4g, while 198.51.100.31 answers\" distance=110]] > 0) do={:do {/tool netwatch enable [find name=\"4g-198.51.100.31-steady\" disabled=yes]} on-error={}}} else={:if ([:len [/ip route find comment=\"atlantis: 4g, while 198.51.100.31 answers\" distance!=110]] > 0) do={:do {/tool netwatch enable [find name=\"4g-198.51.100.31-silence\" disabled=yes]} on-error={}}}" timeout=3s type=simple up-script="/tool netwatch disable [find name=\"4g-198.51.100.31-silence\"]"
add comment="atlantis: 4g, silent by 198.51.100.31" disabled=yes host=198.51.100.31 interval=23s name=4g-198.51.100.31-silence packet-count=4 packet-interval=5s startup-delay=30s test-script=":if (\$\"response-count\" = 0) do={/ip route set [find comment=\"atlantis: 4g, while 198.51.100.31 answers\"] distance=110; :if ([:len [/ip route find comment~\"^atlantis: 4g, while\" distance!=110]] = 0) do={ :do {/ip firewall connection remove [find reply-dst-address~\"^10.10.9.2:\"]} on-error={}}; /tool netwatch disable [find name=\"4g-198.51.100.31-silence\"]}" timeout=3s type=icmp
add comment="atlantis: 4g, steady by 198.51.100.31" disabled=yes host=198.51.100.31 interval=2m8s name=4g-198.51.100.31-steady packet-count=25 packet-interval=5s startup-delay=30s test-script=":if (\$\"response-count\" = 25) do={/ip route set [find comment=\"atlantis: 4g, while 198.51.100.31 answers\"] distance=10; :do {/ip firewall connection remove [find reply-dst-address~\"^(10.10.10.2):\"]} on-error={}; /tool netwatch disable [find name=\"4g-198.51.100.31-steady\"]}" timeout=3s type=icmp
add comment="atlantis: 4g, by 198.51.100.32" down-script="/tool netwatch disable [find name=\"4g-198.51.100.32-steady\"]; /tool netwatch enable [find name=\"4g-198.51.100.32-silence\"]" host=198.51.100.32 interval=30s name=4g-198.51.100.32-watch startup-delay=30s test-script=":if ([:len [/tool netwatch find name=\"4g-198.51.100.32-watch\" status=up]] > 0) do={:if ([:len [/ip route find comment=\"atlantis: 4g, while 198.51.100.32 answers\" distance=110]] > 0) do={:do {/tool netwatch enable [find name=\"4g-198.51.100.32-steady\" disabled=yes]} on-error={}}} else={:if ([:len [/ip route find comment=\"atlantis: 4g, while 198.51.100.32 answers\" distance!=110]] > 0) do={:do {/tool netwatch enable [find name=\"4g-198.51.100.32-silence\" disabled=yes]} on-error={}}}" timeout=3s type=simple up-script="/tool netwatch disable [find name=\"4g-198.51.100.32-silence\"]"
add comment="atlantis: 4g, silent by 198.51.100.32" disabled=yes host=198.51.100.32 interval=23s name=4g-198.51.100.32-silence packet-count=4 packet-interval=5s startup-delay=30s test-script=":if (\$\"response-count\" = 0) do={/ip route set [find comment=\"atlantis: 4g, while 198.51.100.32 answers\"] distance=110; :if ([:len [/ip route find comment~\"^atlantis: 4g, while\" distance!=110]] = 0) do={ :do {/ip firewall connection remove [find reply-dst-address~\"^10.10.9.2:\"]} on-error={}}; /tool netwatch disable [find name=\"4g-198.51.100.32-silence\"]}" timeout=3s type=icmp
add comment="atlantis: 4g, steady by 198.51.100.32" disabled=yes host=198.51.100.32 interval=2m8s name=4g-198.51.100.32-steady packet-count=25 packet-interval=5s startup-delay=30s test-script=":if (\$\"response-count\" = 25) do={/ip route set [find comment=\"atlantis: 4g, while 198.51.100.32 answers\"] distance=10; :do {/ip firewall connection remove [find reply-dst-address~\"^(10.10.10.2):\"]} on-error={}; /tool netwatch disable [find name=\"4g-198.51.100.32-steady\"]}" timeout=3s type=icmp
# Log: more lines in memory, and what is serious also on disk, where it survives the power cut that may have caused it.
# Nothing is sent to a log server: none is declared. (Rows of /system logging have no comment.)
/system logging action
set memory memory-lines=2000
/system logging
add action=disk topics=critical
add action=disk topics=error
# Doors that nobody needs (MikroTik manual, "Securing your router"). IPv6 is off because no filter of ours sees it.
# ddns-enabled=auto is how 7.17 and later spell off.
/ip cloud
set ddns-enabled=auto update-time=no
/ip neighbor discovery-settings
set discover-interface-list=none
/ip proxy
set enabled=no
/ip socks
set enabled=no
# A source that no route leads back to is not believed. `strict` would ask for the way back in the main table alone: manual,
# "strict mode does not work with routing tables", and there is one for each link.
/ip settings
set accept-redirects=no accept-source-route=no rp-filter=loose
/ip upnp
set enabled=no
/ipv6 settings
set accept-redirects=no accept-router-advertisements=no disable-ipv6=yes forward=no
/snmp
set enabled=no
/tool bandwidth-server
set enabled=no
/tool mac-server
set allowed-interface-list=none
/tool mac-server mac-winbox
set allowed-interface-list=none
/tool mac-server ping
set enabled=no
/tool romon
set enabled=no
# Services, last: only what is encrypted stays, and only for those who may manage this router. Accounts are made when a
# router is adopted; passwords cannot be read back, so they are not declared here.
/ip ssh
set forwarding-enabled=no strong-crypto=yes
/ip service
set api disabled=yes
set api-ssl address=10.64.102.0/24,10.80.0.0/24 certificate=atlantis-api disabled=no port=8729 tls-version=only-1.2
set ftp disabled=yes
set ssh address=10.64.102.0/24,10.80.0.0/24 disabled=no port=22
set telnet disabled=yes
set winbox disabled=yes
set www disabled=yes
set www-ssl disabled=yes
