# A configured router; the technician's laptop, 10.64.101.10, is plugged into ether8.
/interface ethernet
set [ find default-name=ether1 ] name=ether1 disabled=false
set [ find default-name=ether2 ] name=ether2 disabled=false
set [ find default-name=ether8 ] name=ether8 disabled=false
/interface bridge
add comment="atlantis: LAN" name=bridge-lan disabled=false
/interface bridge port
add bridge=bridge-lan comment="atlantis: LAN" interface=ether2 disabled=false
/interface list
add comment=atlantis name=MGMT
add comment=atlantis name=LAN
/interface list member
add comment=atlantis interface=ether8 list=MGMT disabled=false
add comment=atlantis interface=bridge-lan list=LAN disabled=false
/interface ovpn-client
add comment=atlantis connect-to=vpn.example.org name=ovpn-scc user=router password=x disabled=false
/ip address
add address=10.64.101.1/24 comment="atlantis: management" interface=ether8 network=10.64.101.0 disabled=false
add address=10.64.1.1/24 comment="atlantis: LAN" interface=bridge-lan network=10.64.1.0 disabled=false
add address=10.80.0.9/32 interface=ovpn-scc network=10.80.0.1 dynamic=true
/ip firewall address-list
add address=10.64.101.0/24 comment=atlantis list=management disabled=false
add address=10.80.0.0/24 comment=atlantis list=management disabled=false
/ip firewall filter
add action=accept chain=input comment="atlantis: management" dst-port=22,8729 protocol=tcp src-address-list=management
add action=accept chain=input comment="atlantis: answers" connection-state=established,related,untracked
add action=drop chain=input comment="atlantis: everything else"
/ip route
add comment=atlantis dst-address=10.80.0.0/16 gateway=ovpn-scc distance=1
add comment=atlantis dst-address=0.0.0.0/0 gateway=10.64.1.254 distance=1
add dst-address=10.64.101.0/24 gateway=ether8 dynamic=true connect=true
/ip service
set api-ssl dynamic=true port=8729 address=10.64.101.1
set ssh port=22 disabled=false address=""
set api-ssl port=8729 disabled=false address=10.64.101.0/24,10.80.0.0/24 certificate=atlantis-api
/certificate
add name=atlantis-api
/user
add comment="atlantis: provisioner" group=full name=provision disabled=false
/user group
add name=full policy=local,telnet,ssh,ftp,reboot,read,write,policy,test,winbox,password,web,sniff,sensitive,api
