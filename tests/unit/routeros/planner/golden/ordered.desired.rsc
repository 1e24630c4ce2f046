# atlantis:entire /ip firewall filter
/ip firewall filter
add action=accept chain=input comment="atlantis: management" dst-port=22,8729 protocol=tcp src-address-list=management
add action=accept chain=input comment="atlantis: one"
add action=accept chain=input comment="atlantis: two" protocol=icmp
add action=accept chain=input comment="atlantis: ah" protocol=ipsec-ah
add action=accept chain=input comment="atlantis: esp" protocol=ipsec-esp
add action=accept chain=input comment="atlantis: sctp" protocol=sctp
add action=accept chain=input comment="atlantis: three" protocol=udp
add action=accept chain=input comment="atlantis: four" protocol=gre
add action=accept chain=input comment="atlantis: five, renamed" protocol=ospf
add action=accept chain=input comment="atlantis: six" protocol=igmp
add action=drop chain=input comment="atlantis: everything else" log=yes
