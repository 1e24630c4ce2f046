/ip dns
hello world
