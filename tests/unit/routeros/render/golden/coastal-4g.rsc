# coastal-4g (Coastal testbed): desired configuration of the 4G box

# Identity: the inventory's name, and who takes care of this box.
/system identity
set name=coastal-4g
/system note
set note="ATLANTIS coastal-4g (Coastal testbed): provisioned from the pilot's declaration. Change the declaration, not the box." show-at-login=yes
# The clock is not asked of anybody: nothing here depends on it, and a time server would be asked over 4G all day.
/system clock
set time-zone-autodetect=no time-zone-name=Europe/Lisbon
/system ntp client
set enabled=no
# Modem. The declared access point is used and not the network's own, which may be another contract; name servers of the
# network are not, because this box asks for no names.
/interface lte apn
add apn=internet.example authentication=none comment="atlantis: the SIM's contract" name=atlantis use-network-apn=no use-peer-dns=no
/interface lte
set [ find default-name=lte1 ] allow-roaming=no apn-profiles=atlantis band=3,7,20 comment="atlantis: 4G" disabled=no name=lte1
# The link to the site's router. The default route is the modem's own, made and taken back with its connection.
/interface ethernet
set [ find default-name=ether1 ] comment="atlantis: cable to the router" disabled=no name=ether1
/ip address
add address=10.10.1.1/29 comment="atlantis: management" interface=ether1
# atlantis:entire /ip dhcp-client
/ip dhcp-client
# atlantis:entire /ip route
/ip route
# It asks nobody for names, and answers nobody.
/ip dns
set allow-remote-requests=no servers=""
# Filter. From the 4G network nothing comes in but answers; the router of the site masquerades, so that everything of it,
# and of the technician behind it, comes from the link's network.
# atlantis:entire /ip firewall address-list
/ip firewall address-list
add address=10.10.1.0/29 comment="atlantis: may manage this box" list=management
# atlantis:entire /ip firewall filter
/ip firewall filter
add action=accept chain=input comment="atlantis: management" dst-port=22,8729 in-interface=ether1 protocol=tcp src-address-list=management
add action=accept chain=input comment="atlantis: ping, to test the link" in-interface=ether1 protocol=icmp src-address-list=management
add action=drop chain=input comment="atlantis: 4G, also what looks like an answer: this box asks nothing" in-interface=lte1
add action=accept chain=input comment="atlantis: answers" connection-state=established,related,untracked
add action=log chain=input comment="atlantis: what is dropped, a sample" limit=10/1m,5:packet log-prefix="drop input"
add action=drop chain=input comment="atlantis: everything else"
add action=drop chain=forward comment="atlantis: invalid" connection-state=invalid
add action=accept chain=forward comment="atlantis: answers" connection-state=established,related,untracked
add action=accept chain=forward comment="atlantis: the router to 4G" in-interface=ether1 out-interface=lte1 src-address=10.10.1.0/29
add action=drop chain=forward comment="atlantis: everything else"
# atlantis:entire /ip firewall nat
/ip firewall nat
add action=masquerade chain=srcnat comment="atlantis: 4G" out-interface=lte1
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
set api-ssl address=10.10.1.0/29 certificate=atlantis-api disabled=no port=8729 tls-version=only-1.2
set ftp disabled=yes
set ssh address=10.10.1.0/29 disabled=no port=22
set telnet disabled=yes
set winbox disabled=yes
set www disabled=yes
set www-ssl disabled=yes
