/interface ethernet
set ether1 [ find default-name=ether1 ] mtu=1500
