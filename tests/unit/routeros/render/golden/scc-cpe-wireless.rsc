# scc-cpe (Control centre): desired configuration of this end of the bridge to coastal-cpe

# Identity: the inventory's name, and who takes care of this radio.
/system identity
set name=scc-cpe
/system note
set note="ATLANTIS scc-cpe (Control centre): provisioned from the pilot's declaration. Change the declaration, and both ends of the bridge with it, not the radio." show-at-login=yes
/interface ethernet
set [ find default-name=ether1 ] comment="atlantis: cable to the router" disabled=no name=ether1
# Radio. Both ends agree on everything but the mode. The station looks for the access point on every legal channel, so that
# it follows when a radar has driven the access point away. skip-dfs-channels keeps that way clear of channels with ten
# minutes of listening. A fixed power is the same at every rate: on a short link full power overdrives the other receiver.
# An antenna whose gain is not declared keeps the gain that the factory has set for it.
/interface wireless security-profiles
add authentication-types=wpa2-psk comment="atlantis: bridge" group-ciphers=aes-ccm mode=dynamic-keys name=atlantis-ptp unicast-ciphers=aes-ccm wpa2-pre-shared-key=EXAMPLE-ptp-key
/interface wireless
set [ find default-name=wlan1 ] antenna-gain=16 band=5ghz-a/n/ac bridge-mode=enabled channel-width=20mhz comment="atlantis: bridge to coastal-cpe" country=portugal disabled=no distance=dynamic frequency=5500 frequency-mode=regulatory-domain installation=outdoor mode=bridge name=wlan1 nv2-cell-radius=10 nv2-preshared-key=EXAMPLE-ptp-key nv2-security=enabled scan-list=default security-profile=atlantis-ptp skip-dfs-channels=10min-cac ssid=EXAMPLE-ATLANTIS-PTP tx-power=10 tx-power-mode=all-rates-fixed wireless-protocol=nv2
# Bridge: cable and radio, nothing else. No spanning tree: two ports make no loop, and its waiting would be added to every
# return of the link.
/interface bridge
add comment="atlantis: cable and radio" name=bridge-ptp protocol-mode=none
# atlantis:entire /interface bridge port
/interface bridge port
add bridge=bridge-ptp comment="atlantis: cable" interface=ether1
add bridge=bridge-ptp comment="atlantis: radio" interface=wlan1
# The address by which both sites manage this radio. An adopted device has it on its port.
/ip address
add address=10.10.0.3/29 comment="atlantis: management" interface=bridge-ptp
# atlantis:entire /ip dhcp-client
/ip dhcp-client
# The way back to both technicians, and by the router that serves the link to the time servers. It does not follow the
# other site's links: without the bridge that end is not to be reached anyhow.
# atlantis:entire /ip route
/ip route
add comment="atlantis: the router that serves the bridge" dst-address=0.0.0.0/0 gateway=10.10.0.1
add comment="atlantis: management of the site that the bridge carries" dst-address=10.64.101.0/24 gateway=10.10.0.2
# It asks nobody for names, and answers nobody.
/ip dns
set allow-remote-requests=no servers=""
# Time: certificates are only good while the clock is right. Servers by address, because names may need the VPN and the VPN
# needs the time.
/system clock
set time-zone-autodetect=no time-zone-name=Europe/Lisbon
/system ntp client
set enabled=yes
/system ntp client servers
add address=192.0.2.123 comment="atlantis: ntp1.example.org"
add address=192.0.2.124 comment="atlantis: ntp2.example.org"
# Filter. What the bridge carries does not pass here; this is about the device itself. Both routers masquerade, so that a
# technician usually comes by a router's own address in the link's network; the management networks are admitted besides.
# atlantis:entire /ip firewall address-list
/ip firewall address-list
add address=10.10.0.0/29 comment="atlantis: may manage this radio" list=management
add address=10.64.101.0/24 comment="atlantis: may manage this radio" list=management
add address=10.64.100.0/24 comment="atlantis: may manage this radio" list=management
# atlantis:entire /ip firewall filter
/ip firewall filter
add action=accept chain=input comment="atlantis: management" dst-port=22,8729 protocol=tcp src-address-list=management
add action=accept chain=input comment="atlantis: ping, to test the bridge" protocol=icmp src-address-list=management
add action=accept chain=input comment="atlantis: answers" connection-state=established,related,untracked
add action=drop chain=input comment="atlantis: invalid" connection-state=invalid
add action=log chain=input comment="atlantis: what is dropped, a sample" limit=10/1m,5:packet log-prefix="drop input"
add action=drop chain=input comment="atlantis: everything else"
add action=drop chain=forward comment="atlantis: a bridge, no router"
# atlantis:entire /ip firewall nat
/ip firewall nat
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
set api-ssl address=10.10.0.0/29,10.64.101.0/24,10.64.100.0/24 certificate=atlantis-api disabled=no port=8729 tls-version=only-1.2
set ftp disabled=yes
set ssh address=10.10.0.0/29,10.64.101.0/24,10.64.100.0/24 disabled=no port=22
set telnet disabled=yes
set winbox disabled=yes
set www disabled=yes
set www-ssl disabled=yes
