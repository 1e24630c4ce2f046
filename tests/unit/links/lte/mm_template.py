"""ModemManager for python-dbusmock, run by the system's own Python, which has its D-Bus bindings.

Debian's python-dbusmock (0.28.7) has no template of ModemManager; the one of 0.38.1 from PyPI lacks Modem.Signal and
Modem3gpp.RegistrationState, and needs dbus-python built from source. Names and types of the properties are those of
ModemManager's published D-Bus API. Whatever would set something is there, too, and the log tells whether it was called.
"""

from typing import Any

import dbus
from dbusmock import OBJECT_MANAGER_IFACE, mockobject

BUS_NAME = "org.freedesktop.ModemManager1"
MAIN_OBJ = "/org/freedesktop/ModemManager1"
MAIN_IFACE = BUS_NAME
SYSTEM_BUS = True
MODEM = f"{BUS_NAME}.Modem"
SIGNATURES = {
    "State": "i",
    "StateFailedReason": "u",
    "UnlockRequired": "u",
    "UnlockRetries": "a{uu}",
    "AccessTechnologies": "u",
    "SignalQuality": "(ub)",
    "Bearers": "ao",
    "PrimarySimSlot": "u",
    "RegistrationState": "u",
    "OperatorCode": "s",
    "OperatorName": "s",
    "Imei": "s",
    "Rate": "u",
    "Lte": "a{sv}",
    "Nr5g": "a{sv}",
    "Connected": "b",
    "Properties": "a{sv}",
    "Ip4Config": "a{sv}",
}
SETTERS = {
    MODEM: [("Enable", "b"), ("SetPowerState", "u"), ("Reset", ""), ("Command", "su"), ("CreateBearer", "a{sv}")],
    f"{MODEM}.Signal": [("Setup", "u")],
    f"{MODEM}.Modem3gpp": [("Register", "s"), ("Scan", "")],
}


def typed(name: str, value: Any) -> Any:  # noqa: ANN401 - D-Bus of any shape
    signature = SIGNATURES[name]
    if signature == "a{uu}":
        return dbus.Dictionary({dbus.UInt32(int(k)): dbus.UInt32(v) for k, v in value.items()}, signature="uu")
    if signature == "a{sv}":
        return dbus.Dictionary({str(k): _variant(v) for k, v in value.items()}, signature="sv")
    if signature == "ao":
        return dbus.Array([dbus.ObjectPath(each) for each in value], signature="o")
    if signature == "(ub)":
        return dbus.Struct((dbus.UInt32(value[0]), dbus.Boolean(value[1])), signature="ub")
    return {"i": dbus.Int32, "u": dbus.UInt32, "s": dbus.String, "b": dbus.Boolean}[signature](value)


def _variant(value: Any) -> Any:  # noqa: ANN401 - D-Bus of any shape
    return dbus.Double(value) if isinstance(value, float) else value


def load(mock: Any, parameters: Any) -> None:  # noqa: ANN401 - dbusmock has no types
    mock.AddMethods(MAIN_IFACE, [("ScanDevices", "", "", "")])
    objects = {str(path): interfaces for path, interfaces in parameters.items()}
    for path, interfaces in objects.items():
        names = list(interfaces)
        first = {name: typed(name, value) for name, value in interfaces[names[0]].items()}
        mock.AddObject(path, names[0], first, [(name, takes, "", "") for name, takes in SETTERS.get(names[0], ())])
        added = mockobject.objects[path]
        for name in names[1:]:
            added.AddProperties(name, {key: typed(key, value) for key, value in interfaces[name].items()})
            added.AddMethods(name, [(method, takes, "", "") for method, takes in SETTERS.get(name, ())])
    code = "ret = {dbus.ObjectPath(k): objects[k].props for k in objects if '/Modem/' in k}"
    mock.AddMethod(OBJECT_MANAGER_IFACE, "GetManagedObjects", "", "a{oa{sa{sv}}}", code)
