/interface ethernet
set [ find default-name=ether1 mtu=1500
