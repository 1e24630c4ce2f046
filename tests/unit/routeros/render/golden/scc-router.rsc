# scc-router (Control centre): desired configuration

# Identity: the inventory's name, and who takes care of this router.
/system identity
set name=scc-router
/system note
set note="ATLANTIS scc-router (Control centre): provisioned from the pilot's declaration. Change the declaration, not the router." show-at-login=yes
# Ports have their factory names, which are those of the sockets: a port that somebody has renamed gets its name back. The
# comment says what a port is for. Power goes to the radio heads; of two ports the one with the lower poe-priority keeps
# its power longer. Ports without a use are off, also those that nobody has declared, like the cage of an SFP.
# atlantis:undeclared /interface ethernet disabled=yes
/interface ethernet
set [ find default-name=ether1 ] comment="atlantis: uplink" disabled=no name=ether1
set [ find default-name=ether2 ] comment="atlantis: wifi-ptp" disabled=no name=ether2 poe-out=auto-on poe-priority=5
set [ find default-name=ether3 ] comment="atlantis: lan" disabled=no name=ether3
set [ find default-name=ether4 ] comment="atlantis: lan" disabled=no name=ether4
set [ find default-name=ether5 ] comment="atlantis: off" disabled=yes name=ether5
set [ find default-name=ether6 ] comment="atlantis: off" disabled=yes name=ether6
set [ find default-name=ether7 ] comment="atlantis: off" disabled=yes name=ether7
set [ find default-name=ether8 ] comment="atlantis: management" disabled=no name=ether8
# LAN: one bridge over the LAN ports. rstp, because on a quay a cable is soon plugged in twice, and one loop would stop the
# whole site. The management port never joins the bridge: it is the way in when the bridge is at fault.
/interface bridge
add comment="atlantis: LAN" name=bridge-lan protocol-mode=rstp
# atlantis:entire /interface bridge port
/interface bridge port
add bridge=bridge-lan comment="atlantis: LAN" interface=ether3
add bridge=bridge-lan comment="atlantis: LAN" interface=ether4
/ip address
add address=10.64.0.1/24 comment="atlantis: LAN" interface=bridge-lan
# The technician's port. This address stands on an adopted router already, and the session that provisions it uses it.
add address=10.64.100.1/24 comment="atlantis: management" interface=ether8
# Links that lead out of the site. Addresses are declared, so no DHCP client: one would bring a default route and name
# servers of its own, and those of a dead link stay behind.
/ip address
add address=203.0.113.2/29 comment="atlantis: uplink" interface=ether1
add address=10.10.0.1/29 comment="atlantis: wifi-ptp, our end" interface=ether2
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
add address=10.64.0.11 comment="atlantis: scc-control.scc.example.org" name=scc-control.scc.example.org
add address=10.10.0.3 comment="atlantis: scc-cpe.scc.example.org" name=scc-cpe.scc.example.org
add address=10.64.0.1 comment="atlantis: scc-router.scc.example.org" name=scc-router.scc.example.org
add address=10.64.0.10 comment="atlantis: scc-vpn.scc.example.org" name=scc-vpn.scc.example.org
add address=203.0.113.2 comment="atlantis: vpn.example.org" name=vpn.example.org
# Interface lists: the firewall speaks of these. Ours entirely, because one wrong member opens the LAN to the world.
/interface list
add comment="atlantis: robots, gateway, operators" name=LAN
add comment="atlantis: the technician's port" name=MGMT
add comment="atlantis: links that end here and carry another site" name=SERVED
add comment="atlantis: links by which this site reaches the world" name=WAN
# atlantis:entire /interface list member
/interface list member
add comment="atlantis: LAN" interface=bridge-lan list=LAN
add comment="atlantis: management" interface=ether8 list=MGMT
add comment="atlantis: wifi-ptp" interface=ether2 list=SERVED
add comment="atlantis: uplink" interface=ether1 list=WAN
# DHCP for the LAN. Reservations give each robot and computer the address by which the others know it.
/ip pool
add comment="atlantis: LAN" name=dhcp-lan ranges=10.64.0.100-10.64.0.199
/ip dhcp-server
add address-pool=dhcp-lan comment="atlantis: LAN" disabled=no interface=bridge-lan lease-time=1h name=dhcp-lan
/ip dhcp-server network
add address=10.64.0.0/24 comment="atlantis: LAN" dns-server=10.64.0.1 domain=scc.example.org gateway=10.64.0.1 ntp-server=192.0.2.123,192.0.2.124
/ip dhcp-server lease
add address=10.64.0.10 comment="atlantis: scc-vpn" mac-address=02:00:5E:00:00:10 server=dhcp-lan
add address=10.64.0.11 comment="atlantis: scc-control" mac-address=02:00:5E:00:00:11 server=dhcp-lan
# Address lists that the filter consults; ours entirely, because an entry is a permission.
# atlantis:entire /ip firewall address-list
/ip firewall address-list
add address=10.64.0.11 comment="atlantis: scc-control, ours, in the LAN" list=hosts
add address=10.64.0.10 comment="atlantis: scc-vpn, ours, in the LAN" list=hosts
add address=10.80.0.0/16 comment="atlantis: tunnel addresses, behind the VPN" list=remote
add address=10.64.1.0/24 comment="atlantis: coastal LAN, behind the VPN" list=remote
add address=10.64.2.0/24 comment="atlantis: te4sea LAN, behind the VPN" list=remote
# Filter. No fasttrack: its packets skip the filter, and with it the satellite's allow-list.
# atlantis:entire /ip firewall filter
/ip firewall filter
# Input: what may speak to the router itself. Management first, whatever else is wrong below, and each network of managers by
# the interfaces behind which it is: its addresses are only names to whoever sends from elsewhere. The LAN's rules name its prefix:
# at the control centre, partners of the VPN also come in by the LAN, from the VPN server.
add action=accept chain=input comment="atlantis: management" dst-port=22,8729 in-interface-list=MGMT protocol=tcp src-address=10.64.100.0/24
add action=accept chain=input comment="atlantis: ping from management" in-interface-list=MGMT protocol=icmp src-address=10.64.100.0/24
add action=accept chain=input comment="atlantis: management by the VPN" dst-port=22,8729 in-interface-list=LAN protocol=tcp src-address=10.80.0.0/24
add action=accept chain=input comment="atlantis: ping from management by the VPN" in-interface-list=LAN protocol=icmp src-address=10.80.0.0/24
add action=accept chain=input comment="atlantis: answers" connection-state=established,related,untracked
add action=drop chain=input comment="atlantis: invalid" connection-state=invalid
add action=accept chain=input comment="atlantis: DHCP of hosts without address" dst-port=67 in-interface-list=LAN protocol=udp src-address=0.0.0.0
add action=accept chain=input comment="atlantis: DHCP and DNS" dst-port=53,67 in-interface-list=LAN protocol=udp src-address=10.64.0.0/24
add action=accept chain=input comment="atlantis: DNS, long answers" dst-port=53 in-interface-list=LAN protocol=tcp src-address=10.64.0.0/24
add action=accept chain=input comment="atlantis: ping from the LAN" in-interface-list=LAN protocol=icmp src-address=10.64.0.0/24
add action=accept chain=input comment="atlantis: ping over wifi-ptp, to test it" in-interface=ether2 protocol=icmp src-address=10.10.0.0/29
add action=log chain=input comment="atlantis: what is dropped, a sample" limit=10/1m,5:packet log-prefix="drop input"
add action=drop chain=input comment="atlantis: everything else"
# Forward: what may pass through.
# The VPN server stands in this LAN: to other sites and back, packets turn round on the bridge, and the router sees one
# direction only. Its connection tracking would call that invalid. Ours reach everything behind the VPN. What else is plugged
# in may be a partner's robot: it opens no TCP connection to another site, and the VPN server forbids more.
add action=accept chain=forward comment="atlantis: our hosts to the VPN by its server" dst-address-list=remote in-interface-list=LAN out-interface-list=LAN src-address-list=hosts
add action=accept chain=forward comment="atlantis: LAN to tunnel addresses by the VPN's server" dst-address=10.80.0.0/16 in-interface-list=LAN out-interface-list=LAN src-address=10.64.0.0/24
add action=accept chain=forward comment="atlantis: pings to other sites by the VPN's server" dst-address-list=remote in-interface-list=LAN out-interface-list=LAN protocol=icmp src-address=10.64.0.0/24
add action=accept chain=forward comment="atlantis: datagrams to other sites by the VPN's server" dst-address-list=remote in-interface-list=LAN out-interface-list=LAN protocol=udp src-address=10.64.0.0/24
add action=accept chain=forward comment="atlantis: answers to other sites by the VPN's server" dst-address-list=remote in-interface-list=LAN out-interface-list=LAN protocol=tcp src-address=10.64.0.0/24 tcp-flags=ack
add action=drop chain=forward comment="atlantis: invalid" connection-state=invalid
add action=accept chain=forward comment="atlantis: answers of forwarded services" connection-nat-state=dstnat connection-state=established,related
# After a change of link, flows of before may go out with the addresses of the LAN: nobody could answer them. New connections
# are left alone here, because source NAT comes after this chain.
add action=drop chain=forward comment="atlantis: stale, not masqueraded" connection-nat-state=!srcnat connection-state=established,related out-interface-list=WAN
add action=accept chain=forward comment="atlantis: answers" connection-state=established,related,untracked
add action=accept chain=forward comment="atlantis: LAN by the best link" in-interface-list=LAN out-interface-list=WAN src-address=10.64.0.0/24
add action=accept chain=forward comment="atlantis: technician to the LAN" in-interface-list=MGMT out-interface-list=LAN src-address=10.64.100.0/24
add action=accept chain=forward comment="atlantis: technician by the best link" in-interface-list=MGMT out-interface-list=WAN src-address=10.64.100.0/24
add action=accept chain=forward comment="atlantis: technician to the radios" in-interface-list=MGMT out-interface-list=SERVED src-address=10.64.100.0/24
add action=accept chain=forward comment="atlantis: wifi-ptp by our best link" in-interface=ether2 out-interface-list=WAN src-address=10.10.0.0/29
# Anybody may send to these: of one address 32 connections a second begin, and those that are open are accepted above.
add action=accept chain=forward comment="atlantis: forwarded to scc-vpn" connection-nat-state=dstnat dst-address=10.64.0.10 dst-limit=32,32,src-address/10s dst-port=1194 out-interface-list=LAN protocol=udp
add action=accept chain=forward comment="atlantis: forwarded to scc-control" connection-nat-state=dstnat dst-address=10.64.0.11 dst-limit=32,32,src-address/10s dst-port=862 out-interface-list=LAN protocol=udp
add action=log chain=forward comment="atlantis: what is dropped, a sample" limit=10/1m,5:packet log-prefix="drop forward"
add action=drop chain=forward comment="atlantis: everything else"
# Output is open but for the satellite: the router itself asks for time, pings its canaries and holds the tunnel.
# NAT. Every uplink is masqueraded, the Wi-Fi bridge to the control centre included: the links are interchangeable, so the far
# end needs no route back to this LAN that would go stale with the link. Sites reach each other inside the VPN, un-NATed,
# where real addresses and the partners' separation hold.
# atlantis:entire /ip firewall nat
/ip firewall nat
add action=dst-nat chain=dstnat comment="atlantis: scc-vpn at uplink" dst-address=203.0.113.2 dst-port=1194 protocol=udp to-addresses=10.64.0.10
# From the LAN by the outer address: the answer must come back through the router, or its sender would not be recognised.
add action=masquerade chain=srcnat comment="atlantis: scc-vpn from the LAN" dst-address=10.64.0.10 dst-port=1194 out-interface-list=LAN protocol=udp src-address=10.64.0.0/24
add action=dst-nat chain=dstnat comment="atlantis: scc-control at uplink" dst-address=203.0.113.2 dst-port=862 protocol=udp to-addresses=10.64.0.11
# From the LAN by the outer address: the answer must come back through the router, or its sender would not be recognised.
add action=masquerade chain=srcnat comment="atlantis: scc-control from the LAN" dst-address=10.64.0.11 dst-port=862 out-interface-list=LAN protocol=udp src-address=10.64.0.0/24
add action=masquerade chain=srcnat comment="atlantis: uplinks" out-interface-list=WAN
# The radios of a served link need no route to the technician.
add action=masquerade chain=srcnat comment="atlantis: technician to the radios" out-interface-list=SERVED src-address=10.64.100.0/24
# MSS: tunnel and terminal add headers, and a TCP segment that must be cut in two doubles its risk of loss. 1300 leaves room
# for either. postrouting also covers the router's own connections.
# atlantis:entire /ip firewall mangle
/ip firewall mangle
# Failover. A link with canaries is good while one of them answers: default routes lead to the canaries, which are reached
# over that link alone. Equal distance: both must fail before the next link is taken. A satellite is not probed unless a budget
# is declared for it, because probes cost airtime: it is what is left. A blackhole behind each canary keeps it from answering over another link when its
# own is down; scope 30 is above target-scope 11, so default routes do not lead there.
# When a link is left and when it is taken back is decided below, under /tool netwatch; it moves these routes by their
# distance: 10 for each place in the order of preference, and 100 more while the link is given up. Should netwatch stand
# still, traffic moves all the same: at once and without damping, by check-gateway=ping where asking costs nothing, and
# where it costs, by check-gateway=arp, which asks the box at this end only.
/routing table
add comment="atlantis: uplink only" fib name=via-uplink
# atlantis:entire /ip route
/ip route
add comment="atlantis: canary of uplink" dst-address=198.51.100.1/32 gateway=203.0.113.1 scope=10
add blackhole comment="atlantis: canary of uplink, by no other link" distance=254 dst-address=198.51.100.1/32 scope=30
add comment="atlantis: canary of uplink" dst-address=198.51.100.2/32 gateway=203.0.113.1 scope=10
add blackhole comment="atlantis: canary of uplink, by no other link" distance=254 dst-address=198.51.100.2/32 scope=30
add comment="atlantis: uplink, not probed" distance=10 dst-address=0.0.0.0/0 gateway=203.0.113.1
# One table a link, without a way round: a ping from the link's own address tests this link.
add comment="atlantis: uplink only" dst-address=0.0.0.0/0 gateway=203.0.113.1@main routing-table=via-uplink
# Behind the VPN. While the tunnel is down these addresses lead nowhere, and never out on a link in the clear.
add comment="atlantis: tunnel addresses" dst-address=10.80.0.0/16 gateway=10.64.0.10
add blackhole comment="atlantis: tunnel addresses, by the VPN only" distance=254 dst-address=10.80.0.0/16 scope=30
add comment="atlantis: coastal LAN" dst-address=10.64.1.0/24 gateway=10.64.0.10
add blackhole comment="atlantis: coastal LAN, by the VPN only" distance=254 dst-address=10.64.1.0/24 scope=30
add comment="atlantis: te4sea LAN" dst-address=10.64.2.0/24 gateway=10.64.0.10
add blackhole comment="atlantis: te4sea LAN, by the VPN only" distance=254 dst-address=10.64.2.0/24 scope=30
# atlantis:entire /routing rule
/routing rule
# First everything that main knows but its default route (min-prefix=0): neighbours of a link answer from any address.
add action=lookup comment="atlantis: connected and static prefixes" min-prefix=0 table=main
add action=lookup-only-in-table comment="atlantis: uplink, from its own address" src-address=203.0.113.2/32 table=via-uplink
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
set api-ssl address=10.64.100.0/24,10.80.0.0/24 certificate=atlantis-api disabled=no port=8729 tls-version=only-1.2
set ftp disabled=yes
set ssh address=10.64.100.0/24,10.80.0.0/24 disabled=no port=22
set telnet disabled=yes
set winbox disabled=yes
set www disabled=yes
set www-ssl disabled=yes
