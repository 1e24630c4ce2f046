"""Entry point of the launcher, run as `python -S atlantis_netcfg/__main__.py`.

Stop signals end the process or are ignored before the command line handles them, and after it has finished. Python's
own handler would print a traceback in the middle of an import, or lose the signal there.
"""

import _signal  # type: ignore[import-not-found] # built in; `signal` imports much before it can answer any
import sys

if __name__ == "__main__":
    if _signal.getsignal(_signal.SIGINT) is not _signal.SIG_IGN:
        _signal.signal(_signal.SIGINT, _signal.SIG_DFL)
    if sys.flags.no_site:
        import site

        site.main()

    from atlantis_netcfg.cli import main

    code = main()
    for number in (_signal.SIGINT, _signal.SIGTERM, _signal.SIGHUP):
        _signal.signal(number, _signal.SIG_IGN)
    sys.exit(code)
