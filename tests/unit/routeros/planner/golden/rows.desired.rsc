/system identity
set name="router of \"the quay\""
/interface ovpn-client
add connect-to=vpn.example.org comment="atlantis: VPN" name=vpn password="new \$ecret" user=router
add connect-to=vpn2.example.org comment="atlantis: VPN" name=vpn2 password=second user=router
/interface ethernet
set [ find default-name=ether1 ] disabled=yes poe-out=off
/ip address
add address=10.64.1.1/24 comment="atlantis: LAN" interface=bridge-lan
/ip dhcp-server network
add address=10.64.1.0/24 comment="atlantis: LAN" gateway=10.64.1.1
/routing table
add comment=atlantis fib name=via-4g
/ip route
add blackhole comment=atlantis distance=254 dst-address=10.9.0.0/16
/ip service
set ftp disabled=yes
/ip dns
set servers=9.9.9.9
/interface list
add comment=atlantis name=LAN
