"""Modules that libraries import at their head and that no command uses: executed when something of
them is asked for. To be imported before scipy.
"""

import contextlib
import importlib.util
import sys


def only_when_used(package: str, name: str) -> None:
    """Have a module of a package executed when something of it is asked for; one that is not there,
    or was executed, stays as it is.
    """
    full_name = f"{package}.{name}"
    spec = None
    with contextlib.suppress(ModuleNotFoundError):
        spec = None if full_name in sys.modules else importlib.util.find_spec(full_name)
    if spec is None or spec.loader is None:
        return
    spec.loader = importlib.util.LazyLoader(spec.loader)
    sys.modules[full_name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules[full_name])
    # `from package import name` takes what the package has by that name; to look it up among the
    # modules would execute it
    setattr(sys.modules[package], name, sys.modules[full_name])


# scipy takes every name of numpy: a compiler of Fortran and tools for tests are among them
only_when_used("numpy", "f2py")
only_when_used("numpy", "testing")
