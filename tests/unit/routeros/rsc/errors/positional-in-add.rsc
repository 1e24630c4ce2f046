/ip firewall filter
add input action=accept
