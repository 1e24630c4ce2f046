# 2026-01-01 08:00:00 by RouterOS 7.18.2
# software id = 1E8B-F5B5
#
# model = RB5009UPr+S+
# serial number = HGX0A1B2C3D
/interface bridge
add name=lan
/interface ethernet
set [ find default-name=ether1 ] comment="to the \"terminal\"" poe-out=off
/interface list
add name=WAN
/interface ovpn-client
add connect-to=vpn.example.org disabled=no mac-address=48:A9:8A:C5:3C:FE \
    name=vpn user=coastal
/routing table
add fib name=via-sat
/interface list member
add interface=ether1 list=WAN
/ip address
add address=10.64.101.1/24 comment="atlantis: management" interface=ether8 \
    network=10.64.101.0
/ip firewall filter
add action=accept chain=input connection-state=established,related
add action=drop chain=input disabled=yes in-interface-list=!WAN
/ip route
add distance=1 dst-address=10.9.0.0/16 gateway=10.64.101.9
add blackhole dst-address=10.8.0.0/16
/ip service
set telnet disabled=yes
set api-ssl certificate=atlantis-api
/system identity
set name="Quay 7"
/system logging
set 0 topics=info,!dhcp
add action=disk topics=error
/system note
set show-at-login=no
