/ip dns
set servers= allow-remote-requests=no
