"""Compilation of the kernels at installation; where it does not work, calibkit installs without
them.
"""

import os
import runpy
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class KernelsBuildHook(BuildHookInterface[Any]):
    """Adds the compiled library to a wheel, which then is one of this platform, of any Python."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and say so where it does not work; CALIBKIT_NATIVE=off builds a wheel of any
        platform.
        """
        if os.environ.get("CALIBKIT_NATIVE") == "off":
            return
        folder = Path(self.root) / "calibkit" / "native"
        # calibkit itself is not installed yet
        compiling = runpy.run_path(str(folder / "compiling.py"))
        wrong = compiling["compile_kernels"](folder)
        if wrong:
            (folder / compiling["LIBRARY"]).unlink(missing_ok=True)
            self.app.display_warning(f"calibkit is installed without compiled kernels: {wrong}")
            return
        if version == "standard":
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{platform}"
            build_data["artifacts"].append(f"calibkit/native/{compiling['LIBRARY']}")
