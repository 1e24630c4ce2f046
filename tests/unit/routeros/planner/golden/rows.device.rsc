/system identity
set name=MikroTik
/interface ovpn-client
add connect-to=vpn.example.org comment="atlantis: VPN" name=vpn password=old user=router
/interface ethernet
set [ find default-name=ether1 ] name=ether1 disabled=false poe-out=auto-on
/ip address
add address=10.64.1.1/24 comment="atlantis: LAN" disabled=false interface=ether2 network=10.64.1.0
add address=10.64.9.1/24 comment="atlantis: old LAN" disabled=true interface=ether3 network=10.64.9.0
add address=10.0.0.1/24 comment="hers" interface=ether4 network=10.0.0.0
/ip dhcp-server network
add address=10.64.1.0/24 comment="atlantis: LAN" gateway=10.64.1.1 next-server=10.64.1.9
/ip service
set ftp disabled=false port=21
/ip dns
set servers=9.9.9.9
/interface list
add comment=atlantis name=LAN
