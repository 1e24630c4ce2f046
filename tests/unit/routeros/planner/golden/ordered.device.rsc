/ip firewall filter
add action=passthrough chain=forward comment="special dummy rule to show fasttrack counters" dynamic=true
add action=accept chain=input comment="atlantis: one" disabled=false
add action=accept chain=input comment="atlantis: two" protocol=icmp
add action=accept chain=input comment="atlantis: ah" protocol=ipsec-ah
add action=accept chain=input comment="atlantis: esp" protocol=ipsec-esp
add action=accept chain=input comment="atlantis: sctp" protocol=sctp
add action=accept chain=input comment="atlantis: three" protocol=udp
add action=accept chain=input comment="atlantis: four" protocol=gre
add action=accept chain=input comment="atlantis: five" protocol=ospf
add action=accept chain=input comment="her own rule" dst-port=8291 protocol=tcp
add action=accept chain=input comment="atlantis: eight" protocol=l2tp
add action=accept chain=input comment="atlantis: nine" protocol=vrrp
add action=accept chain=input comment="atlantis: six" protocol=igmp
add action=drop chain=input comment="atlantis: everything else" log=true
