/ip dns
:local a 1
