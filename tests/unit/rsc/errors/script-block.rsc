{
/ip dns
}
